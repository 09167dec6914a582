"""A field that effects change, as splines for the chip."""

import numpy as np
import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.model.with_effects import with_effects
from femfit.targets.c_code import export_c
from femfit.targets.splined import NEAR, splined
from support.added_effects import usual
from support.compiling import needs_compiler


def changed(model, *names):
    return with_effects(model, [usual(effect_by_name(name), 1.0 / 3.0) for name in names])


@pytest.mark.parametrize("name", ["one circuit", "solenoid", "law", "eddies"])
def test_a_saturating_core_is_followed_by_splines_as_near_as_they_say(model_kind, name):
    model = changed(model_kind(name), "core_saturation", "coil_temperature")
    light, error = splined(model)
    assert light is not model
    assert 0.0 < error <= NEAR
    box, random = model.validity, np.random.default_rng(0)
    d = random.uniform(box.distance_min_m, box.distance_max_m, 500)
    i = random.uniform(*box.current_limits_A[0], 500)
    for quantity in ("force", "flux_linkage"):
        wanted, found = (getattr(one, quantity)(d, i) for one in (model, light))
        assert (
            np.abs(found - wanted).max() <= 1.5 * error * np.abs(wanted).max()
        )  # between the points that were looked at
    if model.sensor is not None:
        wanted, found = (one.sensor.field.field(d, i[:, None]) for one in (model, light))
        assert np.abs(found - wanted).max() <= 1.5 * error * np.abs(wanted).max()
    assert (light.circuits, light.motion, light.effects) == (model.circuits, model.motion, model.effects)


def test_what_splines_do_not_lighten_stays_as_it_is(levitation_model, model_kind):
    unchanged = levitation_model, changed(levitation_model, "magnet_temperature"), model_kind("saturating")
    assert all(splined(model) == (model, 0.0) for model in unchanged)


@needs_compiler
def test_the_difference_that_is_printed_contains_that_of_the_splines(levitation_model, tmp_path):
    paths, difference = export_c(changed(levitation_model, "core_saturation"), tmp_path, None, "ukf", "float")
    assert 2e-7 < difference < 3e-6  # single precision alone is off by 3e-8 m
    _, error = splined(changed(levitation_model, "core_saturation"))
    text = next(path for path in paths if path.name == "README.md").read_text()
    assert f"within {error:.1g} of the largest" in " ".join(text.split())
