"""Currents of the direct measurement's coil equations, against scipy's matrix exponential."""

import numpy as np
import pytest
from scipy.linalg import expm

from femfit.fit.build import fit_model
from femfit.model.drive import circuit_terms
from femfit.simulation.observers import coil_currents
from support.bearing import CIRCUITS, ENTRY, table_of

BRIDGES = [{**circuit, "voltage_min_V": -24.0, "drive": {}} for circuit in CIRCUITS]


@pytest.mark.parametrize("currents", [(1.0, -0.5), (0.0, 1.5)])
def test_two_coupled_coils_follow_their_matrix_exponential(currents):
    """L i' = U - R i + k_m v with distance and velocity held over a sample."""
    model = fit_model(table_of(entry={**ENTRY, "circuits": BRIDGES})).model
    mean, volts = np.array([[0.4e-3, 0.05, *currents]]), np.array([[6.0, -3.0]])
    _, motional, inductance = circuit_terms(model, mean[:, 0], mean[:, 2:])
    drive = np.linalg.solve(inductance[0], volts[0] + 0.05 * motional[0])
    A = -np.linalg.solve(inductance[0], np.diag(model.resistances_ohm))
    whole = expm(model.sample_time_s * np.block([[A, drive[:, None]], [np.zeros((1, 3))]]))
    expected = whole[:2, :2] @ currents + whole[:2, 2]
    np.testing.assert_allclose(coil_currents(model, mean, volts)[0], expected, rtol=1e-9)
