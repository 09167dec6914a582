"""Every effect that a diagnosis should know is in the catalogue, keeps the contract, and is said in plain words."""

import importlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jinja2 import Template

import femfit.effects
from effect_signature import typical_parameters
from femfit.effects.catalogue import BUILT_IN, effect_by_name
from femfit.effects.effect import AddedEffect, Effect
from femfit.effects.words import describe, range_of, size_of, smallest_visible, titled
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from support.added_effects import conditions_at

TESTS = Path(__file__).parents[1]


def test_every_file_of_the_room_is_listed():
    folder = Path(femfit.effects.__file__).parent
    found = {
        value.name
        for file in folder.glob("*.py")
        for value in vars(importlib.import_module(f"femfit.effects.{file.stem}")).values()
        if isinstance(value, Effect)
    }
    assert found == {effect.name for effect in BUILT_IN}


@pytest.mark.parametrize("effect", BUILT_IN, ids=lambda e: e.name)
def test_an_effect_says_what_users_need(effect):
    assert set(effect.acts_on) <= {"bench", "magnetics", "force", "circuit", "motion", "sensor"}
    assert effect.amplitudes
    assert len({p.name for p in effect.parameters}) == len(effect.parameters)
    texts = [*(p.description for p in effect.parameters), *(c.instruction for c in effect.calibrations)]
    for p in effect.parameters:
        assert p.lower <= p.plausible[0] < p.plausible[1] <= p.upper
        assert p.lower <= p.null <= p.upper
        assert p.null == 0.0 or p.nonlinear
    assert all(text.endswith(".") for text in (effect.symptom, effect.experiment, *texts))
    assert effect.reference
    for c in effect.calibrations:
        assert set(c.reads) <= {p.name for p in effect.amplitudes}
        assert min(c.cost, *c.reads.values()) > 0.0


@pytest.mark.parametrize("effect", BUILT_IN, ids=lambda e: e.name)
def test_an_effect_at_its_null_changes_nothing(effect, levitation_model):
    # Off the knots of the base's spline, where its fourth derivative jumps
    d, i = (x.ravel() for x in np.meshgrid(np.linspace(0.01545, 0.04365, 7), np.linspace(0.0, 1.4, 7)))
    known = {"memory": {}, "motional_V": 0.05 * np.cos(np.arange(49.0)), "current_turn_A": (0.0, 1.4)}
    at = conditions_at(levitation_model, 49, **known)
    plain = predict_readings(levitation_model, d, i, at)
    shapes = [{p.name: value} for p in effect.parameters if p.nonlinear for value in (p.null, *p.plausible)]
    for shape in shapes or [{}]:
        read = predict_readings(levitation_model, d, i, at, [AddedEffect(effect, effect.null() | shape)])
        for channel, values in plain.items():
            np.testing.assert_allclose(read[channel], values, rtol=1e-13)


def test_the_page_of_effects_says_what_the_catalogue_says(expected):
    template = (TESTS / "support" / "effects.md.j2").read_text(encoding="utf-8")
    text = Template(template, keep_trailing_newline=True).render(effects=BUILT_IN)
    expected.text(TESTS.parent / "docs" / "effects.md", text)


def test_model_files_of_earlier_versions_find_the_drawings_tolerances():
    for name, now in (("magnet_strength", "remanence"), ("turns", "turns"), ("resistance", "resistance")):
        assert effect_by_name(f"base_{name}").name == now


@pytest.fixture(scope="module")
def nominal(levitation_model):
    return nominal_of(levitation_model)


def said(name, nominal, ci95=None, **parameters):
    effect = effect_by_name(name)
    return describe(AddedEffect(effect, effect.null() | parameters, ci95 or {}), nominal)


def test_the_first_of_two_sizes_that_need_as_much_of_their_range_is_said(nominal):
    effect = next(one for one in BUILT_IN if len(one.amplitudes) > 1)
    first, second = effect.amplitudes[:2]
    sizes = {first.name: 0.1 * first.width, second.name: 0.1 * (1.0 - 1e-9) * second.width}
    alone = smallest_visible(effect, {first.name: sizes[first.name]}, nominal)
    assert smallest_visible(effect, sizes, nominal) == alone


@pytest.mark.parametrize("effect", BUILT_IN, ids=lambda effect: effect.name)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_every_effect_is_said_without_an_internal_name_and_with_units(effect, sign, nominal):
    for p, typical in zip(effect.amplitudes, typical_parameters(effect).values(), strict=True):
        value = max(sign * typical, p.lower)
        text = "; ".join(said(effect.name, nominal, **{p.name: value}))
        if value == p.null or p.name.startswith("gap_"):
            assert not text
            continue
        assert re.search(r"\d+(\.\d+)? (%|[nµmk]?[A-Z]|m/s|mm|ms|s\b|K)", text), text
        assert not set("_{") & set(text)


SAID = [
    ("remanence", {}, {"remanence_error": -0.042}, "the magnet is 4.2 % weaker than drawn"),
    ("distance_offset", {"offset_m": (1.8e-4, 2.2e-4)}, {"offset_m": 2.04e-4},
     "the gap is 0.20 mm larger than recorded (95 %: 0.18 to 0.22 mm)"),
    ("turns", {"turns_error": (-0.05, -0.03)}, {"turns_error": -0.04},
     "the winding has 4.0 % fewer turns than drawn (95 %: 3.0 to 5.0 %)"),
    ("lateral_misalignment", {}, {"offset_squared_m2": 2.25e-6}, "the moving part hangs 1.5 mm beside the axis"),
    ("hall_drift", {"ramp_V": (-36.0, 36.0)}, {"ramp_V": -0.01},
     "Drift over 1000 readings (or seconds) of the campaign: not determined (95 %: -36 to 36 V)"),
]  # fmt: skip


def test_a_weak_magnet_a_larger_gap_and_a_saturating_core_are_said_as_an_engineer_would(nominal):
    for name, ci95, parameters, text in SAID:
        assert said(name, nominal, ci95, **parameters) == [text]
    (core,) = said("core_saturation", nominal, mmf_loss_3=0.01, mmf_loss_32=0.015)
    share = float(re.search(r"loses ([\d.]+) %", core).group(1))
    assert 1.5 < share < 2.5  # the demagnetising field withdraws a part of 2.5 %


def test_what_is_nothing_beside_a_wide_interval_is_not_determined(nominal):
    (narrow,) = said("hall_drift", nominal, {"ramp_V": (-0.002, 0.002)}, ramp_V=-1e-5)  # known to be next to none
    assert "drifts by 0.0 mV in" in narrow  # and not by -0
    (clear,) = said("hall_drift", nominal, {"ramp_V": (-1.0, 9.0)}, ramp_V=4.0)
    assert "drifts by 4" in clear


def test_the_interval_of_a_number_of_the_drawing_is_said_to_be_of_first_order(nominal):
    turns = effect_by_name("turns")
    drawn = replace(turns, title="the winding's turns")
    first, known = (AddedEffect(e, {"turns_error": 0.04}, {"turns_error": (0.03, 0.05)}) for e in (drawn, turns))
    assert describe(first, nominal)[0].endswith("(95 %: 3.0 to 5.0 %, to first order; femfit calibrate finds the size)")
    assert describe(known, nominal)[0].endswith("(95 %: 3.0 to 5.0 %)")


def test_the_smallest_visible_size_is_said_of_the_shape_that_shows_best(nominal):
    effect = effect_by_name("core_saturation")
    small = smallest_visible(effect, {"mmf_loss_3": 0.3, "mmf_loss_6": 0.01, "mmf_loss_32": float("inf")}, nominal)
    assert float(re.search(r"loses ([\d.]+) %", small).group(1)) == pytest.approx(1.0, abs=0.1)
    assert smallest_visible(effect, {"mmf_loss_3": float("inf")}, nominal) == ""


def test_an_eccentric_plunger_is_not_called_a_magnet(nominal):
    (text,) = said("lateral_misalignment", replace(nominal, magnet_share=0.0), gap_all=0.03)
    assert "3.0 % more flux linkage" in text


def test_a_time_constant_is_said_as_a_time_and_no_share(nominal):
    for name, time in (("coil_temperature", "warming_time"), ("hall_drift", "settling_time")):
        p = next(one for one in effect_by_name(name).parameters if one.name == time)
        assert "%" not in size_of(p, 100.0, nominal)
        assert "%" not in range_of(p, *p.plausible, nominal)
        assert range_of(p, *p.plausible, nominal).startswith("20 to 500 ")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Missing: one of KEY, distance_offset or turns; femfit calibrate finds it.",
         "Missing: one of TITLE, distance_offset or turns; femfit calibrate finds it."),
        ("<p>With KEY fitted: <code>femfit add MODEL.json KEY bench.csv --with KEY</code> has KEY.</p>",
         "<p>With TITLE fitted: <code>femfit add MODEL.json KEY bench.csv --with KEY</code> has TITLE.</p>"),
        ("  KEY: it is 0.1 mm more, or KEY[1] or pole.KEY", "  TITLE [KEY]: it is 0.1 mm more, or KEY[1] or pole.KEY"),
    ],
)  # fmt: skip
def test_a_number_is_called_by_its_title_but_in_a_command_that_is_typed(text, shown):
    key, title = "fixed.regions.pole.z_mm[1]", "the pole's face at z = 5 mm"
    assert titled(text.replace("KEY", key), {key: title}) == shown.replace("KEY", key).replace("TITLE", title)
