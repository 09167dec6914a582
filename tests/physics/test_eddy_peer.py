"""A pot of solid iron against scikit-fem, which has r A_phi as its unknown and elements of its own."""

import numpy as np
import pytest

from femfit.device.load import actuator_from_toml
from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import ORDER
from support.eddy_pot import POT
from support.eddy_transient import mesh_for
from support.peer_harmonic import inductance

DISTANCE = 1.5e-3


def test_inductance_and_loss_are_those_of_another_program():
    pytest.importorskip("skfem")
    actuator, frequencies = actuator_from_toml(POT), np.array([30.0, 1000.0])
    moving = mesh_for(actuator, DISTANCE, frequencies[-1])
    found, _ = EddyProbe(actuator, moving, DISTANCE, ORDER).transfers(frequencies)
    ours = found.flux_linkage[:, 0, 0]
    coarse, fine = (np.array([inductance(actuator, moving, one, splits) for one in frequencies]) for splits in (0, 1))
    assert np.abs(fine / ours - 1.0).max() < 6e-4  # of the peer's quadratic elements: 3e-5 if split once more
    assert (np.abs(fine / ours - 1.0) < 0.3 * np.abs(coarse / ours - 1.0)).all()
    assert fine.imag == pytest.approx(ours.imag, rel=2e-3)
