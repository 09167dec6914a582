"""Every effect that a diagnosis should know is in the catalogue, and every one keeps the contract."""

import importlib
from pathlib import Path

import numpy as np
import pytest
from jinja2 import Template

import femfit.effects
from femfit.effects.catalogue import BUILT_IN, effect_by_name
from femfit.effects.effect import AddedEffect, Effect
from femfit.model.readings import predict_readings
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
    at = conditions_at(levitation_model, 49, motional_V=0.05 * np.cos(np.arange(49.0)), current_turn_A=(0.0, 1.4))
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
