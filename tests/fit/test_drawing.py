"""Numbers of a drawing as effects of a model: fitted from a sweep's signatures, kept in its file, and right."""

import copy
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.effects.effect import AddedEffect
from femfit.field.sweep import run_sweep
from femfit.fit.build import fit_model
from femfit.identify.bench import bench_observations
from femfit.identify.signatures import effect_columns
from femfit.model.json_file import read_model, write_model
from femfit.model.with_effects import with_effects
from femfit.tables.measurement_file import read_bench_table
from femfit.tables.sweep_table import read_sweep_table
from support.one_current import flat
from support.small_drawing import SMALL, at_distances

HEIGHT, RADIUS, IRON = (
    "moving.regions.magnet.z_mm[1]",
    "fixed.regions.core.r_mm[1]",
    "materials.iron.relative_permeability",
)


def _sweep(directory, text):
    directory.mkdir()
    (directory / "small.toml").write_text(text)
    return run_sweep(directory / "small.toml", directory / "run", workers=1)


@pytest.fixture(scope="module")
def table(small_sweep):
    return read_sweep_table(small_sweep / "run")


@pytest.fixture(scope="module")
def model(table):
    return fit_model(table).model


@pytest.mark.parametrize("material", ["iron", pytest.param("steel_1010", marks=pytest.mark.nightly)])
def test_between_the_points_of_its_sweep_a_model_has_the_force_and_flux_linkage_of_the_field(tmp_path, material):
    """The field is solved at distances and currents that the sweep left out."""
    currents = "[0, 1, 2, 3, 4]" if material == "steel_1010" else "[0, 0.5, 1]"
    text = SMALL.replace('material = "iron"', f'material = "{material}"').replace("[0, 0.5, 1]", currents)
    assert currents in text
    model = fit_model(_sweep(tmp_path / "drawn", text)).model
    here = at_distances(text, "[4.5, 6.2, 9.7]").replace(currents, "[0.3, 0.8]")
    rows = _sweep(tmp_path / "between", here).rows
    for name in ("force", "flux_linkage"):
        solved = rows["force_N" if name == "force" else "flux_linkage_Wb"]
        missed = getattr(model, name)(rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()) - solved
        assert np.abs(missed).max() < 2e-3 * np.abs(solved).max()


def _drawn(model, key):
    (one,) = (one for one in model.drawn if one.key == key)
    return one


def test_every_number_that_changes_something_is_in_the_model(table, model):
    assert [one.key for one in model.drawn] == [one.key for one in table.signatures.numbers if not one.effect]
    number = _drawn(model, RADIUS)
    assert (number.value, number.unit, number.tolerance) == (5.0, "mm", 0.01)
    (amplitude,) = number.effect.parameters
    assert (amplitude.name, amplitude.unit, amplitude.plausible) == ("change_mm", "mm", (-0.03, 0.03))


def test_splines_follow_the_slopes_of_force_flux_linkage_and_hall_field(table, model):
    """By the facade of the model, effects and all; to a thousandth of the largest slope of the number."""
    for number in (one for one in table.signatures.numbers if not one.effect):
        slopes, drawn = table.signatures.of(number), replace(_drawn(model, number.key), gap_m=0.0)  # the first order
        changed = with_effects(model, [AddedEffect(drawn.effect, {drawn.parameter: number.tolerance})])
        size = drawn.terms[0].size({drawn.parameter: number.tolerance})
        d, i = slopes["distance_m"].to_numpy(), slopes["current_A"].to_numpy()
        pairs = [
            (flat(changed.magnetics).force(d, i) - flat(model.magnetics).force(d, i), "force_N"),
            (flat(changed.magnetics).flux_linkage(d, i) - flat(model.magnetics).flux_linkage(d, i), "flux_linkage_Wb"),
            (flat(changed.sensor.field).field(d, i) - flat(model.sensor.field).field(d, i), "hall_T"),
        ]
        for change, name in pairs:
            wanted = slopes[name].to_numpy()
            least = 1e-6 * np.abs(table.rows[name]).max() / size  # the tables' own polynomials
            assert np.abs(change / size - wanted).max() <= 1e-3 * np.abs(wanted).max() + least


def test_a_model_file_keeps_the_numbers_and_an_added_one_and_damage_is_refused_by_its_place(model, tmp_path):
    drawn = _drawn(model, HEIGHT)
    added = with_effects(model, [AddedEffect(drawn.effect, {"change_mm": 0.05}, {"change_mm": (0.04, 0.06)})])
    write_model(added, tmp_path / "model.json")
    again = read_model(tmp_path / "model.json")
    assert [vars(one).keys() == vars(other).keys() for one, other in zip(again.drawn, model.drawn, strict=True)]
    assert _drawn(again, HEIGHT).effect is again.effects[0].effect
    assert again.effects[0].parameters == {"change_mm": 0.05}
    assert float(again.force(0.006, 0.7)) == pytest.approx(float(added.force(0.006, 0.7)), rel=1e-12)
    copied = copy.deepcopy(again)
    assert float(copied.force(0.006, 0.7)) == pytest.approx(float(added.force(0.006, 0.7)), rel=1e-12)
    write_model(model, tmp_path / "model.json")
    data = json.loads((tmp_path / "model.json").read_text())
    data["drawn"][0]["tolerance"] = -1.0
    (tmp_path / "model.json").write_text(json.dumps(data))
    with pytest.raises(ValueError, match=r"drawn\[0\]\.tolerance must be a finite number > 0"):
        read_model(tmp_path / "model.json")


def _bench(table, path, noise=(2e-5, 2e-7, 2e-4)):
    """What a bench would read of a device whose field is a table's, three times."""
    rng, rows = np.random.default_rng(3), table.valid_rows()
    runs = [
        pd.DataFrame(
            {
                "run": run,
                "distance_m": rows["distance_m"],
                "current_A": rows["current_A"],
                "force_N": rows["force_N"] + noise[0] * rng.standard_normal(len(rows)),
                "flux_linkage_Wb": rows["flux_linkage_Wb"] + noise[1] * rng.standard_normal(len(rows)),
                "hall_V": 2.5 + 50.0 * rows["hall_T"] + noise[2] * rng.standard_normal(len(rows)),
            }
        )
        for run in range(3)
    ]
    pd.concat(runs).to_csv(path, index=False)
    return path


@pytest.mark.nightly
def test_columns_are_the_differences_of_whole_sweeps_and_their_fits(model, tmp_path):
    """Of every reading of a bench, to a thousandth of the largest in its channel, of a magnet 0.06 mm taller and lower.

    Each of both drawings is swept.
    """
    taller = [
        _sweep(tmp_path / name, SMALL.replace("z_mm = [0, 4]", f"z_mm = [0, {name}]")) for name in ("4.06", "3.94")
    ]
    observations = bench_observations(model, read_bench_table(_bench(taller[0], tmp_path / "bench.csv")))
    (found,) = effect_columns(_drawn(model, HEIGHT).effect, observations)
    high, low = (
        bench_observations(fit_model(one).model, read_bench_table(tmp_path / "bench.csv")).base for one in taller
    )
    wanted = (high - low) / 0.12
    for name in observations.channels:
        of = observations.of(name)
        error = np.abs(found.columns[of, 0] - wanted[of]).max()
        assert 0.0 < error <= 2e-3 * np.abs(wanted[of]).max()


def test_a_permeability_acts_by_its_reciprocal(model, tmp_path):
    """A core of 500 that has 400: a fifth less is a quarter more of reluctivity, by which the co-energy goes."""
    weaker = fit_model(_sweep(tmp_path / "weaker", SMALL.replace("_permeability = 500", "_permeability = 400"))).model
    drawn = _drawn(model, IRON)
    changed = with_effects(model, [AddedEffect(drawn.effect, {drawn.parameter: -0.2})])
    d, i = np.linspace(4e-3, 12e-3, 9), np.full(9, 1.0)
    for name in ("force", "flux_linkage"):
        wanted = getattr(weaker, name)(d, i) - getattr(model, name)(d, i)
        np.testing.assert_allclose(getattr(changed, name)(d, i) - getattr(model, name)(d, i), wanted, rtol=0.02)
