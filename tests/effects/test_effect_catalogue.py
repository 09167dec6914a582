"""Every effect that a diagnosis should know is in the catalogue, and every one keeps the contract."""

import importlib
from pathlib import Path

import numpy as np
import pytest
from jinja2 import Template

import femfit.effects
from femfit.effects.catalogue import BUILT_IN, effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect, Effect
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of

TESTS = Path(__file__).parents[1]
STAGES = {"bench", "magnetics", "force", "circuit", "motion", "sensor"}


@pytest.fixture(scope="module")
def points(levitation_model):
    box = levitation_model.validity
    # Off the knots of the base's spline, where its fourth derivative jumps
    d = np.linspace(1.03 * box.distance_min_m, 0.97 * box.distance_max_m, 7)
    i = np.linspace(box.current_min_A, box.current_max_A, 7)
    return [x.ravel() for x in np.meshgrid(d, i)]


@pytest.fixture(scope="module")
def at(levitation_model, points):
    t = np.arange(len(points[0]), dtype=float)
    return Conditions(
        nominal_of(levitation_model),
        branch=np.where(t % 2, 1.0, -1.0),
        coil_temperature_C=20.0 + 0.5 * t,
        magnet_temperature_C=20.0 + 0.2 * t,
        time_s=t,
        elapsed=t + 10.0,
        velocity_m_s=0.1 * np.cos(t),
        current_rate_A_s=3.0 * np.sin(t),
        motional_V=0.05 * np.cos(t),
        current_turn_A=(0.0, 1.4),
    )


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
    assert set(effect.acts_on) <= STAGES
    assert effect.amplitudes
    assert len({p.name for p in effect.parameters}) == len(effect.parameters)
    for p in effect.parameters:
        assert p.lower <= p.plausible[0] < p.plausible[1] <= p.upper
        assert p.lower <= p.null <= p.upper
        assert p.null == 0.0 or p.nonlinear
        assert p.description.endswith(".")
    assert effect.symptom.endswith(".")
    assert effect.experiment.endswith(".")
    assert effect.reference
    for c in effect.calibrations:
        assert set(c.reads) <= {p.name for p in effect.amplitudes}
        assert min(c.cost, *c.reads.values()) > 0.0
        assert c.instruction.endswith(".")


@pytest.mark.parametrize("effect", BUILT_IN, ids=lambda e: e.name)
def test_an_effect_at_its_null_changes_nothing(effect, levitation_model, points, at):
    d, i = points
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
