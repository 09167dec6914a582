"""Numbers of a drawing as effects of a model: fitted from a sweep's signatures, kept in its file, and right."""

from dataclasses import replace

import numpy as np
import pytest

from femfit import fit_model, run_sweep
from femfit.effects.effect import AddedEffect
from femfit.model.with_effects import with_effects
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
    functions = {
        "force_N": model.force,
        "flux_linkage_Wb": model.flux_linkage,
        "hall_T": flat(model.sensor.field).field,
    }
    for name, function in functions.items():
        missed = function(rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()) - rows[name]
        assert np.abs(missed).max() < 2e-3 * np.abs(rows[name]).max(), name


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


@pytest.mark.parametrize(
    ("key", "drawn_as", "changes", "size"),
    [
        # A core of 500 that has 400: a fifth less is a quarter more of reluctivity, by which the co-energy goes
        (IRON, "_permeability = 500", {"_permeability = 400": 1.0, "_permeability = 500": -1.0}, -0.2),
        pytest.param(
            HEIGHT,
            "z_mm = [0, 4]",
            {"z_mm = [0, 4.06]": 0.5, "z_mm = [0, 3.94]": -0.5},
            0.06,
            marks=pytest.mark.nightly,
        ),
    ],
    ids=["permeability", "height"],
)
def test_a_number_acts_as_between_whole_sweeps_and_their_fits(model, tmp_path, key, drawn_as, changes, size):
    drawn = _drawn(model, key)
    changed = with_effects(model, [AddedEffect(drawn.effect, {drawn.parameter: size})])
    others = {text: fit_model(_sweep(tmp_path / text, SMALL.replace(drawn_as, text))).model for text in changes}
    point = np.linspace(4e-3, 12e-3, 9), np.full(9, 1.0)
    for name in ("force", "flux_linkage"):
        wanted = sum(share * getattr(others[text], name)(*point) for text, share in changes.items())
        np.testing.assert_allclose(getattr(changed, name)(*point) - getattr(model, name)(*point), wanted, rtol=0.02)
