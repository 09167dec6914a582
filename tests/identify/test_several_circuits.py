"""A bench of several circuits beside its model: what is hidden in it is found by name, and halves are the whole."""

import copy
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import MissingPartError, TableError, UsageError
from femfit.effects.catalogue import device_effects, effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.fit.build import fit_model
from femfit.identify.comparison.compare import compare
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.experiments.suggest import suggest
from femfit.identify.refit.add_effects import add_effects
from femfit.model.json_file import read_model, write_model
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of, with_effects
from femfit.report.write import write_report
from support.bearing import NAMES, table_of
from support.halves import cut_in_two

NOISE = {"force_N": 0.3, "flux_linkage": 2e-5, "voltage": 2e-3}


@pytest.fixture(scope="module")
def model():
    """The bearing with bridges; its bias magnet is known from its forces without current."""
    return fit_model(table_of()).model


def bench(model, path, *, gap=0.0, gain=(1.0, 1.0), force_gain=1.0, resistance=(1.0, 1.0), seed=1):
    """Two runs of one mounting over distances and both currents, and what is wrong with it.

    A mounting is believed to 20 um: a gap that is to be named must be clearly more.
    """
    generator = np.random.default_rng(seed)
    grid = np.meshgrid([1, 2], np.linspace(0.28e-3, 0.72e-3, 7), [-1.5, 0, 1.5], [-1.5, 0, 1.5], indexing="ij")
    run, d, *i = (axis.ravel() for axis in grid)
    true = np.stack([g * one for g, one in zip(gain, i, strict=True)], axis=1)
    flux = model.magnetics.flux_linkage(d + gap, true)
    rows = {"run": run, "mount": 1, "distance_m": d, "current_lower_A": i[0], "current_upper_A": i[1]}
    rows["force_N"] = force_gain * model.magnetics.force(d + gap, true) + NOISE["force_N"] * generator.normal(
        size=len(d)
    )
    for k, name in enumerate(NAMES):
        ohms = model.circuits[k].resistance_ohm * resistance[k]
        rows[f"flux_linkage_{name}_Wb"] = flux[:, k] + NOISE["flux_linkage"] * generator.normal(size=len(d))
        rows[f"voltage_{name}_V"] = ohms * true[:, k] + NOISE["voltage"] * generator.normal(size=len(d))
    pd.DataFrame(rows).to_csv(path, index=False)
    return path


@pytest.mark.parametrize(
    ("wrong", "named", "size"),
    [
        ({}, None, None),
        ({"gap": 7e-5}, "distance_offset", ("offset_m", 7e-5)),
        ({"gain": (1.04, 1.0)}, "current_gain:lower", ("gain_error", 0.04)),
        ({"gain": (1.0, 0.97)}, "current_gain:upper", ("gain_error", -0.03)),
        ({"resistance": (1.0, 1.05)}, "resistance:upper", ("resistance_error", 0.05)),
        ({"force_gain": 1.05}, "force_gain", ("gain_error", 0.05)),
    ],
    ids=["clean", "gap", "lower ammeter", "upper ammeter", "upper winding", "force sensor"],
)
def test_what_is_wrong_is_named(model, tmp_path, wrong, named, size):
    found = diagnose(model, bench(model, tmp_path / "bench.csv", **wrong), bootstrap=0, rng=1)
    if named is None:
        assert found.verdict == "nothing_missing"
        return
    assert [one.name for one in found.missing] == [named]
    assert found.missing[0].parameters[size[0]] == pytest.approx(size[1], rel=0.03)


def test_what_is_found_is_added_kept_and_shown(model, tmp_path):
    file = bench(model, tmp_path / "bench.csv", gain=(1.04, 1.0), resistance=(1.0, 1.05))
    found = diagnose(model, file, bootstrap=0, rng=1)
    added = add_effects(model, file, found)
    write_model(added.model, tmp_path / "model.json")
    again = read_model(tmp_path / "model.json")
    assert {one.effect.name for one in again.effects} == {"current_gain:lower", "resistance:upper"}
    assert again.circuits[1].resistance_ohm == pytest.approx(1.05 * model.circuits[1].resistance_ohm, rel=1e-3)
    assert copy.deepcopy(again.effects)[0].effect is again.effects[0].effect
    assert "agrees" in str(compare(again, file)).splitlines()[0]
    assert "in circuit lower" in write_report(found, tmp_path / "found.html").read_text(encoding="utf-8")
    assert "current_gain:lower" in str(suggest(model, file, found))
    assert " A in lower" in str(compare(model, file)).splitlines()[0]


def test_only_effects_that_several_circuits_can_have_are_considered():
    names = list(device_effects(NAMES))
    assert "current_gain:lower" in names
    assert "current_gain" not in names
    assert "hysteresis" not in names
    assert list(device_effects(("coil",)))[:3] == ["distance_offset", "remanence", "turns"]
    with pytest.raises(UsageError):
        effect_by_name("hysteresis:lower")


def test_turns_and_remanence_scale_the_sources_of_the_one_coenergy(model):
    """Force and flux linkages of the changed model obey reciprocity, and readings of a bench are the model's."""
    effects = [
        AddedEffect(effect_by_name("turns:lower"), {"turns_error": 0.1}),
        AddedEffect(effect_by_name("remanence"), {"remanence_error": -0.2}),
    ]
    changed = with_effects(model, effects)
    d, i, step = np.linspace(0.3e-3, 0.7e-3, 5), np.tile([0.8, -0.4], (5, 1)), 1e-9
    slope = (changed.magnetics.flux_linkage(d + step, i) - changed.magnetics.flux_linkage(d - step, i)) / (2.0 * step)
    motional = changed.magnetics.motional_constant(d, i)
    np.testing.assert_allclose(motional, -slope, atol=1e-5 * np.abs(motional).max())
    force, before = changed.magnetics.force(d, np.zeros((5, 2))), model.magnetics.force(d, np.zeros((5, 2)))
    np.testing.assert_allclose(force, 0.8**2 * before, rtol=1e-9)
    more = 1.1**2 * model.magnetics.inductance(d, i)[:, 0, 0]
    np.testing.assert_allclose(changed.magnetics.inductance(d, i)[:, 0, 0], more, rtol=1e-12)
    assert changed.circuits[0].resistance_ohm == pytest.approx(1.1 * model.circuits[0].resistance_ohm)
    read = predict_readings(changed, d, i, Conditions(nominal_of(model)))
    np.testing.assert_allclose(read["force_N"], changed.magnetics.force(d, i), rtol=1e-12)
    np.testing.assert_allclose(read["flux_linkage_upper_Wb"], changed.magnetics.flux_linkage(d, i)[:, 1], rtol=1e-12)


def test_an_effect_of_one_current_is_refused(model):
    hysteresis = effect_by_name("hysteresis")
    with pytest.raises(MissingPartError, match="hysteresis"):
        with_effects(model, [AddedEffect(hysteresis, hysteresis.null())])


def test_a_current_that_is_missing_is_named(model, tmp_path):
    rows = pd.read_csv(bench(model, tmp_path / "bench.csv"))
    rows.drop(columns="current_upper_A").to_csv(tmp_path / "lacking.csv", index=False)
    with pytest.raises(TableError, match="current_upper_A"):
        compare(model, tmp_path / "lacking.csv")


def test_halves_are_compared_as_the_whole(levitation_model, tmp_path):
    """The same readings beside the coil and beside its halves leave the same errors."""
    whole = replace(levitation_model, sensor=None)
    generator = np.random.default_rng(7)
    run, d, i = (
        a.ravel() for a in np.meshgrid([1, 2], np.linspace(0.017, 0.04, 8), np.linspace(0, 1.4, 5), indexing="ij")
    )
    common = {"run": run, "distance_m": d}
    common["force_N"] = 1.03 * whole.magnetics.force(d, i) + 1e-4 * generator.normal(size=len(d))
    pd.DataFrame({**common, "current_A": i}).to_csv(tmp_path / "one.csv", index=False)
    pd.DataFrame({**common, "current_inner_A": i, "current_outer_A": i}).to_csv(tmp_path / "two.csv", index=False)
    one, two = compare(whole, tmp_path / "one.csv"), compare(cut_in_two(whole), tmp_path / "two.csv")
    assert two.channels[0].rms == pytest.approx(one.channels[0].rms, rel=1e-9)
    assert two.channels[0].noise_floor == pytest.approx(one.channels[0].noise_floor, rel=1e-9)
    assert str(two).splitlines()[0] == str(one).splitlines()[0]
