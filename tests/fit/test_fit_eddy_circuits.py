"""Eddy currents of two circuits: from the sweep into the model."""

import numpy as np

import femfit as ff
from femfit.device.load import actuator_from_toml
from support.eddy_pot import POT

WINDING = """[coils.winding]
r_mm = [5.5, 9]
z_mm = [-8.5, -2]
turns = 200
resistance_ohm = 5
"""
TWO = """[coils.inner]
r_mm = [5.5, 7]
z_mm = [-8.5, -2]
turns = 120
resistance_ohm = 3

[coils.outer]
r_mm = [7.2, 9]
z_mm = [-8.5, -2]
turns = 80
resistance_ohm = 2

[circuits.inner]
coils = ["inner"]
voltage_min_V = -12
voltage_max_V = 12

[circuits.outer]
coils = ["outer"]
voltage_min_V = -12
voltage_max_V = 12
"""


def test_a_model_of_two_circuits_has_the_sweeps_eddy_currents(tmp_path):
    text = POT.replace(WINDING, TWO).replace(
        "current_A = [-1, 0, 1]", "current_A = { inner = [-1, 1], outer = [-1, 1] }"
    )
    text = text.replace("distance_mm = [1, 1.5, 2, 2.5]", "distance_mm = [1, 1.25, 1.5, 1.75, 2]")
    table = ff.run_sweep(actuator_from_toml(text), tmp_path, workers=1)
    model = ff.fit_model(table).model
    frequencies, k = np.array([10.0, 100.0, 1000.0]), 2
    exact = 2j * np.pi * frequencies[:, None, None] * table.eddy.transfers(k, frequencies).flux_linkage
    found = model.impedance(table.eddy.distances_m[k], np.zeros(2), frequencies) - np.diag(model.resistances_ohm)
    size = np.abs(exact).max(axis=(1, 2))
    assert (np.abs(found - exact).max(axis=(1, 2)) < 0.02 * size).all()  # as asked for
    assert (
        np.abs(exact.imag - exact.imag[0] * (frequencies / frequencies[0])[:, None, None])[-1] > 0.1 * size[-1]
    ).any()
    assert model.state_names[4 : 4 + model.eddy.count] == model.eddy_names
