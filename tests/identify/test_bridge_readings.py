"""An LCR meter's inductance and resistance beside a model: further channels of a bench table."""

import numpy as np
import pandas as pd
import pytest

from femfit.effects.catalogue import all_effects
from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.compare import compare
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.readings.bench import conditions_of
from femfit.identify.readings.plausible import suspect_units
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement_file import read_measurement
from support.campaign import settings

BOTH = ("inductance_H", "resistance_ohm")


def bridge_file(model, path, effects=(), seed=1):
    """An LCR sweep at two runs, in millihenry and ohm."""
    rows = settings(model, runs=4, distances=8, currents=5)
    rows = rows[rows["branch"] > 0].reset_index(drop=True)
    at = conditions_of(
        rows.assign(run=rows["run"].astype(int) - 1, mount=0, elapsed=rows["order"], coil_temperature_C=20.0,
                    magnet_temperature_C=20.0),
        nominal_of(model),
    )  # fmt: skip
    d, i = rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()
    read = predict_readings(model, d, i, at, effects, BOTH)
    noise = np.random.default_rng(seed).standard_normal((2, len(rows)))
    table = {"run": rows["run"], "mount": 1, "gap [mm]": 1e3 * d, "I [A]": i}
    table["L [mH]"] = 1e3 * (read["inductance_H"] + 2e-6 * noise[0])
    table["R [Ohm]"] = read["resistance_ohm"] + 2e-3 * noise[1]
    pd.DataFrame(table).to_csv(path, index=False)
    return path


def test_the_inductance_is_the_slope_of_the_flux_linkage(levitation_model):
    at = conditions_of(settings(levitation_model, runs=1).assign(elapsed=0.0), nominal_of(levitation_model))
    d, i, step = np.full(140, 0.02), np.full(140, 0.6), 1e-3
    read = predict_readings(levitation_model, d, i, at, channels=BOTH)
    ahead, behind = (predict_readings(levitation_model, d, i + s, at)["flux_linkage_Wb"] for s in (step, -step))
    np.testing.assert_allclose(read["inductance_H"], (ahead - behind) / (2.0 * step), rtol=1e-6)
    np.testing.assert_allclose(read["resistance_ohm"], levitation_model.circuit.resistance_ohm)
    assert not set(BOTH) & set(predict_readings(levitation_model, d, i, at))


def test_a_sweep_of_a_bridge_is_compared(levitation_model, tmp_path):
    comparison = compare(levitation_model, bridge_file(levitation_model, tmp_path / "lcr.csv"))
    assert comparison.verdict == "agrees"
    noise = {one.channel: one.noise_floor for one in comparison.channels}
    assert set(noise) == set(BOTH)
    assert noise["inductance_H"] == pytest.approx(2e-6, rel=0.3)
    assert noise["resistance_ohm"] == pytest.approx(2e-3, rel=0.3)


def test_a_wrong_resistance_is_found_by_a_bridge(levitation_model, tmp_path):
    effect = all_effects()["resistance"]
    wrong = AddedEffect(effect, {effect.parameters[0].name: 0.05})
    path = bridge_file(levitation_model, tmp_path / "lcr.csv", [wrong])
    found = diagnose(levitation_model, path, bootstrap=0)
    assert found.verdict == "named"
    assert "resistance" in found.missing[0].members


def test_an_inductance_in_another_unit_is_suspected(levitation_model, tmp_path):
    table = read_measurement(bridge_file(levitation_model, tmp_path / "lcr.csv"), units={"L [mH]": "H"})
    (finding,) = suspect_units(levitation_model, table)
    assert (finding.code, finding.column) == ("suspected-unit", "inductance_H")


def test_a_misfit_that_no_effect_changes_is_unexplained(levitation_model, tmp_path):
    rows = pd.read_csv(bridge_file(levitation_model, tmp_path / "lcr.csv"))
    rows["R [Ohm]"] *= 1.0 + 0.02 * rows["gap [mm]"] / 45.0
    rows.drop(columns="L [mH]").to_csv(tmp_path / "r.csv", index=False)
    table = tmp_path / "r.csv"
    found = diagnose(levitation_model, table, bootstrap=0, exclude=("resistance", "coil_temperature"))
    assert found.verdict == "unexplained"
