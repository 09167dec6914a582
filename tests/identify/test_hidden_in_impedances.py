"""Numbers that differ from the drawing, hidden in impedances that the field gave, are named and found."""

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.device.load import actuator_from_toml
from femfit.tables.impedance_table import NAME
from support.eddy_pot import POT

NOISE = 0.001  # of |Z|
GAPS_M = (0.001, 0.0015, 0.0025)
DRAWN = POT.replace("distance_mm = [1, 1.5, 2, 2.5]", "distance_mm = [1, 1.25, 1.5, 1.75, 2, 2.5]").replace(
    "eddy_error = 0.02",
    "eddy_error = 0.002",  # so that the model's own misfit does not hide what 0.1 % of noise shows
)

PERMEABILITY, CONDUCTIVITY = "materials.iron.relative_permeability", "materials.iron.conductivity_MS_per_m"
CORE = "fixed.regions.pot.polygon_mm[5][0]"


def built(permeability=200, conductivity=5, core=5.0):
    text = DRAWN.replace("relative_permeability = 200", f"relative_permeability = {permeability}")
    text = text.replace("conductivity_MS_per_m = 5\n", f"conductivity_MS_per_m = {conductivity}\n")
    return text.replace("[5, -9], [5, 0]", f"[{core}, -9], [{core}, 0]")


def impedances(directory, text):
    """What a sweep of a drawing gives without bias at three gaps."""
    if not (directory / NAME).is_file():
        ff.run_sweep(actuator_from_toml(text), directory, workers=2)
    swept = pd.read_csv(directory / NAME)
    return swept[(swept["current_A"] == 0.0) & swept["distance_m"].isin(GAPS_M)]


def measured(swept, path, seed):
    """Two runs of an impedance meter."""
    rng, runs = np.random.default_rng(seed), []
    for run in (1, 2):
        table = swept[["distance_m", "current_A", "frequency_Hz", "resistance_ohm", "inductance_H"]].copy()
        omega = 2.0 * np.pi * table["frequency_Hz"]
        size = NOISE * np.hypot(table["resistance_ohm"], omega * table["inductance_H"])
        table["resistance_ohm"] += size * rng.normal(size=len(table))
        table["inductance_H"] += size / omega * rng.normal(size=len(table))
        table.insert(0, "run", run)
        runs.append(table)
    pd.concat(runs).to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    directory = tmp_path_factory.mktemp("drawn")
    (directory / "pot.toml").write_text(DRAWN)
    ff.run_sweep(directory / "pot.toml", directory / "run", workers=2, signatures=True)
    return directory, ff.fit_model(directory / "run").model


@pytest.mark.long
@pytest.mark.parametrize(
    ("key", "truth", "change"),
    [
        (PERMEABILITY, {"permeability": 170}, -0.15),
        (CONDUCTIVITY, {"conductivity": 4.4}, -0.12),
        (CORE, {"core": 5.15}, 0.15),
    ],
)
def test_a_number_that_is_not_as_drawn_is_named_with_its_size(model, tmp_path, key, truth, change):
    data = ff.read_measurement(measured(impedances(tmp_path / "built", built(**truth)), tmp_path / "z.csv", 3))
    found = ff.diagnose(model[1], data, rng=1, bootstrap=0)
    assert [key in one for one in found.decision.classes] == [True]
    (added,) = ff.add_effects(model[1], data, key).model.effects
    ((low, high),) = added.ci95.values()
    assert low < change < high
    assert high - low < 0.3 * abs(change)


@pytest.mark.long
def test_nothing_is_named_where_all_is_as_drawn(model, tmp_path):
    swept = impedances(model[0] / "run", DRAWN)
    for seed in range(10):
        data = ff.read_measurement(measured(swept, tmp_path / "z.csv", seed))
        assert not ff.diagnose(model[1], data, rng=1, bootstrap=0).missing


@pytest.mark.long
def test_two_numbers_of_one_material_are_named_together_and_calibrated(model, tmp_path):
    directory, drawn = model
    path = measured(impedances(tmp_path / "built", built(permeability=170, conductivity=6)), tmp_path / "z.csv", 3)
    found = ff.diagnose(drawn, ff.read_measurement(path), rng=1, bootstrap=0)
    members = [set(one) for one in found.decision.classes]
    assert len(members) == 2
    assert {key for key in (PERMEABILITY, CONDUCTIVITY) if any(key in one for one in members)} == {
        PERMEABILITY,
        CONDUCTIVITY,
    }
    result = ff.calibrate(directory / "pot.toml", path, tmp_path / "run", numbers=[PERMEABILITY, CONDUCTIVITY])
    assert result.settled
    for number, truth in zip(sorted(result.numbers, key=lambda one: one.value), (6.0, 170.0), strict=True):
        assert abs(number.value - truth) < 3.0 * number.sd
        assert number.sd < 0.05 * truth
