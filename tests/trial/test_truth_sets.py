"""The three sets of truths: disjoint, complete where the drawing allows, and nothing where nothing is wrong."""

from itertools import combinations

import numpy as np
import pytest

from femfit.device.load import read_actuator
from femfit.effects.catalogue import all_effects
from femfit.trial.device import true_readings
from femfit.trial.truths.sets import SETS, truths_of
from support.actuators import GEOMETRY
from support.closed_form_device import DRAWING, closed_form_device, conditions

DRAWINGS = ("emaws-rig", "solenoid", "voice-coil", "ball")


def truths(drawing):
    return {name: truths_of(GEOMETRY / f"{drawing}.toml", name) for name in SETS}


def numbers(members):
    return {name.rpartition(" (")[0] for name, truth in members.items() if truth.group == "drawing"}


@pytest.mark.parametrize("drawing", DRAWINGS)
def test_no_number_of_a_drawing_is_in_two_sets(drawing):
    sets = truths(drawing)
    for one, other in combinations(SETS, 2):
        assert numbers(sets[one])
        assert not numbers(sets[one]) & numbers(sets[other])
        assert not set(sets[one]) & set(sets[other])


def test_the_same_effect_is_made_in_three_ways():
    device, distance = closed_form_device(), np.linspace(0.0155, 0.0445, 24)
    at = conditions(np.linspace(-1.0, 1.4, 72), np.linspace(20, 50, 72), np.linspace(21, 40, 72), distance, runs=3)
    sets, clean = truths("emaws-rig"), true_readings(device, at, {}, {})
    stems = set.intersection(*({name.rpartition(" (")[0] for name in members} for members in sets.values()))
    solved = {"turns", "remanence", "magnet_demagnetisation", "core_saturation", "core_remanence", "magnet_temperature"}
    for stem in stems - solved - {"spring_in_force"}:  # their drawings differ, which this device does not solve
        shapes = []
        for name, members in sets.items():
            truth = f"{stem} ({name})"
            error = members[truth].build(device, np.random.default_rng(3))
            errors = {truth: error}
            changed = true_readings(device, at, {truth: 0.5 * error.limit(device)}, errors)
            change = np.concatenate([(changed[channel] - clean[channel]) / np.ptp(clean[channel]) for channel in clean])
            assert np.abs(change).max() > 0.0
            shapes.append(change / np.linalg.norm(change))
        for one, other in combinations(shapes, 2):
            assert abs(one @ other) < 1.0 - 1e-6, stem


@pytest.mark.parametrize("name", SETS)
def test_a_truth_of_no_size_changes_nothing(name):
    device, at = closed_form_device(), conditions(1.0, 40.0, 35.0, runs=2)
    clean = true_readings(device, at, {}, {})
    for truth_name, truth in truths_of(DRAWING, name).items():
        error = truth.build(device, np.random.default_rng(1))
        for channel, values in true_readings(device, at, {truth_name: 0.0}, {truth_name: error}).items():
            np.testing.assert_allclose(values, clean[channel], rtol=1e-9, atol=1e-15, err_msg=truth_name)


@pytest.mark.parametrize("drawing", DRAWINGS)
def test_right_names_are_of_the_catalogue_or_of_the_drawing(drawing):
    device = closed_form_device()
    for members in truths(drawing).values():
        for name, truth in members.items():
            if not truth.lacks(read_actuator(GEOMETRY / f"{drawing}.toml")) or drawing == "emaws-rig":
                names = truth.build(device, np.random.default_rng(1)).names
                right = (name.rpartition(" (")[0],) if names is None else names
                assert truth.group in {"drawing", "unseen"} or set(right) & set(all_effects()), name
                assert truth.group != "unseen" or not right


@pytest.mark.parametrize("drawing", DRAWINGS)
def test_what_a_device_cannot_show_has_a_reason(drawing):
    actuator = read_actuator(GEOMETRY / f"{drawing}.toml")
    reasons = {name: truth.lacks(actuator) for name, truth in truths(drawing)["calibration"].items()}
    assert bool(reasons["hall_offset (calibration)"]) is (actuator.hall is None)
    assert bool(reasons["remanence (calibration)"]) is (drawing in {"solenoid", "ball"})
    assert bool(reasons["spring_in_force (calibration)"]) is not bool(actuator.mechanics.springs)
    assert bool(reasons["lateral_misalignment (calibration)"]) is (drawing in {"voice-coil", "ball"})
    assert not reasons["hysteresis (calibration)"]


def dealt(drawing):
    """The numbers of a drawing in all sets: truths by the first key path."""
    found = {name: truth for members in truths(drawing).values() for name, truth in members.items()}
    return {
        name.removeprefix("drawing:").rpartition(" (")[0]: truth
        for name, truth in found.items()
        if truth.group == "drawing"
    }


def test_faces_that_touch_move_together_and_nothing_else_does():
    drawn, key = read_actuator(DRAWING), "fixed.regions.sleeve.r_mm[1]"
    truth = dealt("emaws-rig")[key]
    ((family, forms),) = truth.families(drawn).items()
    assert family == key
    assert truth.build(None, None).names == (key, "coils.coil.r_mm[0]")
    for change, form in forms.items():
        radius = 10e-3 + 1e-3 * change
        assert max(r for r, _ in form.fixed[1].vertices_m) == pytest.approx(radius)
        assert min(r for r, _ in form.coil.vertices_m) == pytest.approx(radius)
        assert form.moving == drawn.moving
        assert (form.fixed[0], form.fixed[2]) == (drawn.fixed[0], drawn.fixed[2])


def test_another_knee_has_another_polarisation_at_each_field():
    drawn = read_actuator(GEOMETRY / "ball.toml")
    ((_, forms),) = dealt("ball")["materials.steel_1010.B_T"].families(drawn).items()
    for change, form in forms.items():
        before, after = (np.array(one.moving.regions[0].material.flux_density_T) for one in (drawn, form))
        field = 4e-7 * np.pi * np.array(drawn.moving.regions[0].material.field_A_per_m)
        np.testing.assert_allclose(after - field, (1.0 + change) * (before - field), rtol=1e-9, atol=1e-15)
