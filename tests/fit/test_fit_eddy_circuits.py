"""Eddy currents of two circuits: from the sweep into the model."""

from dataclasses import asdict, replace

import numpy as np

import femfit as ff
from femfit.core.files import json_ready
from femfit.device.load import actuator_from_toml
from femfit.fit.misfit import sheet_notes
from support.eddy_pot import TWO_WINDINGS


def test_a_model_of_two_circuits_has_the_sweeps_eddy_currents(tmp_path):
    text = TWO_WINDINGS.replace("distance_mm = [1, 1.5, 2, 2.5]", "distance_mm = [1, 1.25, 1.5, 1.75, 2]")
    table = ff.run_sweep(actuator_from_toml(text), tmp_path, workers=1)
    model = ff.fit_model(table).model
    conducts = "conductivity_MS_per_m = 5"
    thick = actuator_from_toml(text.replace(conducts, f"{conducts}\nlamination_mm = 5"))
    of_sheets = replace(table, manifest={**table.manifest, "inputs": json_ready(asdict(thick))})
    assert sum("sheets of 5.0 mm" in note for note in sheet_notes(of_sheets)) == 1
    frequencies, k = np.array([10.0, 100.0, 1000.0]), 2
    exact = 2j * np.pi * frequencies[:, None, None] * table.eddy.transfers(k, frequencies).flux_linkage
    found = model.impedance(table.eddy.distances_m[k], np.zeros(2), frequencies) - np.diag(model.resistances_ohm)
    size = np.abs(exact).max(axis=(1, 2))
    assert (np.abs(found - exact).max(axis=(1, 2)) < 0.02 * size).all()  # as asked for
    assert (
        np.abs(exact.imag - exact.imag[0] * (frequencies / frequencies[0])[:, None, None])[-1] > 0.1 * size[-1]
    ).any()
    assert model.state_names[4 : 4 + model.eddy.count] == model.eddy_names
