"""A conductivity that differs from the drawing, hidden in impedances that the field gave, is named and found."""

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.device.load import actuator_from_toml
from femfit.tables.impedance_table import NAME
from support.eddy_pot import POT

NOISE = 0.001  # of |Z|


def measured(directory, path):
    """Two runs of an impedance meter on the field's own impedances at three distances."""
    swept = pd.read_csv(directory / NAME)
    swept = swept[(swept["current_A"] == 0.0) & (swept["distance_m"] != 0.002)]
    rng, runs = np.random.default_rng(3), []
    for run in (1, 2):
        table = swept[["distance_m", "current_A", "frequency_Hz", "resistance_ohm", "inductance_H"]].copy()
        omega = 2.0 * np.pi * table["frequency_Hz"]
        size = NOISE * np.hypot(table["resistance_ohm"], omega * table["inductance_H"])
        table["resistance_ohm"] += size * rng.normal(size=len(table))
        table["inductance_H"] += size / omega * rng.normal(size=len(table))
        table.insert(0, "run", run)
        runs.append(table)
    pd.concat(runs).to_csv(path, index=False)
    return ff.read_measurement(path)


@pytest.mark.long
def test_a_conductivity_that_is_not_as_drawn_is_named_from_impedances(tmp_path):
    finer = POT.replace("distance_mm = [1, 1.5, 2, 2.5]", "distance_mm = [1, 1.25, 1.5, 1.75, 2, 2.5]")
    built = finer.replace("conductivity_MS_per_m = 5\n", "conductivity_MS_per_m = 4.4\n")
    for name, text in (("drawn", finer), ("built", built)):
        ff.run_sweep(actuator_from_toml(text), tmp_path / name, workers=2)
    model = ff.fit_model(tmp_path / "drawn").model
    data = measured(tmp_path / "built", tmp_path / "z.csv")
    found = ff.diagnose(model, data, rng=1)
    assert "materials.iron.conductivity_MS_per_m" in str(found).splitlines()[0]
    better = ff.add_effects(model, data, found).model
    (added,) = better.effects
    assert added.parameters["change"] == pytest.approx(-0.12, abs=0.02)
