"""Every effect on every kind of model that can have it: one co-energy, and many points as one alone."""

import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest

from femfit.core.errors import MissingPartError
from femfit.core.numerics import central_differences
from femfit.effects.catalogue import BUILT_IN, OF_EACH, of_circuit
from femfit.model.readings import Point, predict_readings, readings_by
from femfit.model.with_effects import with_effects
from support.added_effects import conditions_at, under_effects, usual, usually
from support.compiling import compile_at_once, needs_compiler
from support.model_kinds import rates, states_of
from support.readings import hall_voltage

CHOSEN = ("one circuit", "solenoid", "saturating", "law", "halves", "magnets", "eddies", "halves with eddies")
OF_A_CURRENT, OF_A_SENSOR = ("core_saturation", "hysteresis"), ("external_field",)
"""Scaled by the largest current, and by the winding's field at the Hall element."""

IN_THE_FIELD = [effect for effect in BUILT_IN if effect.coenergy is not None]
COMBINED = ("halves", "eddies")
"""The halves with eddies are both."""


@pytest.fixture(params=[pytest.param(name, marks=[pytest.mark.nightly] * (name in COMBINED)) for name in CHOSEN])
def model(request, model_kind):
    found = model_kind(request.param)
    if request.param == "law":  # a magnet that falls, instead of one that pulls with a meganewton
        far, *near = found.magnetics.coefficients
        found = replace(found, magnetics=replace(found.magnetics, coefficients=(replace(far, value=4e-9), *near)))
    return found


def of_first(model, effect):
    """Of several circuits that of the first one, where an effect is of one."""
    several = len(model.circuits) > 1 and effect.name in OF_EACH
    return of_circuit(effect, model.circuit_names[0]) if several else effect


def changed(model, effect, share=0.3):
    """The model under the effect."""
    if (not model.circuits and effect.name in OF_A_CURRENT) or (model.sensor is None and effect.name in OF_A_SENSOR):
        pytest.skip("not of this kind")
    try:
        return with_effects(model, [usual(of_first(model, effect), share)])
    except MissingPartError:
        pytest.skip("not of this kind")


def close(found, wanted, tolerance):
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=tolerance * np.abs(wanted).max(initial=0.0))


@pytest.mark.parametrize("effect", IN_THE_FIELD, ids=lambda e: e.name)
def test_force_and_flux_linkages_have_one_coenergy_at_many_points_and_at_one(effect, model):
    magnetics = changed(model, effect).windings.magnetics
    states, _ = states_of(model, 40)
    d, w = states[:, 0], states[:, 2:]
    at, scale = np.column_stack([d, w]), np.array([1e-2, *np.ones(w.shape[1])])

    def slope(function):
        return central_differences(lambda x: function(x[:, 0], x[:, 1:]).reshape(len(x), -1), at, scale)

    state, of_force, of_flux = magnetics.state(d, w), slope(magnetics.force), slope(magnetics.flux_linkage)
    close(state.motional_constant, of_force[:, 0, 1:], 1e-6)
    close(-state.motional_constant, of_flux[:, :, 0], 1e-6)
    close(state.inductance, of_flux[:, :, 1:], 1e-6)
    close(-state.force, slope(magnetics.coenergy)[:, 0, 0], 1e-6)
    alone = [magnetics.state(d[k : k + 1], w[k : k + 1]) for k in range(40)]
    for name in ("force", "motional_constant", "inductance"):
        close(np.concatenate([getattr(one, name) for one in alone]), getattr(state, name), 1e-12)


@pytest.mark.parametrize("effect", BUILT_IN, ids=lambda e: e.name)
def test_an_effect_at_its_null_leaves_the_motion_as_it_is_and_points_move_alone_as_together(effect, model):
    same, moved = changed(model, effect, 0.0), changed(model, effect)
    states, volts = states_of(model, 20)
    close(rates(same, states, volts), rates(model, states, volts), 1e-11)
    states, volts = states_of(moved, 20)
    together = rates(moved, states, volts)
    alone = [rates(moved, states[k : k + 1], volts[k : k + 1]) for k in range(20)]
    close(np.concatenate(alone), together, 1e-11)
    assert pickle.dumps(moved)  # and what was worked out of it stays behind
    if model.sensor is not None:
        seen = hall_voltage(moved, states)
        close(np.concatenate([hall_voltage(moved, states[k : k + 1]) for k in range(20)]), seen, 1e-12)


@pytest.mark.parametrize("effect", BUILT_IN, ids=lambda e: e.name)
@pytest.mark.parametrize("share", [pytest.param(0.0, marks=pytest.mark.nightly), 0.3], ids=["at null", "inside"])
@pytest.mark.parametrize("remembered", [True, pytest.param(False, marks=pytest.mark.nightly)], ids=["known", "resting"])
def test_slopes_of_readings_by_parameters_are_their_differences(effect, share, remembered, model):
    changed(model, effect)  # else it is not of this kind
    own = of_first(model, effect)
    added, states = usual(own, share), states_of(model, 12)[0]
    d, i = states[:, 0], states[:, 2 : 2 + len(model.circuits)]
    i = i if i.shape[1] > 1 else i.sum(axis=1)
    conditions = conditions_at(model, 12, **{} if remembered else {"memory": {}})
    names = [p.name for p in own.parameters if share or not p.nonlinear]
    found = readings_by(Point(model, d, i, conditions, [added]), [(0, name) for name in names])
    for j, name in enumerate(names, 1):
        (p,) = [p for p in own.parameters if p.name == name]
        value, step = added.parameters[name], 1e-4 * p.width
        step = step if value + 2.0 * step <= p.upper else -step
        ahead = [replace(added, parameters=added.parameters | {name: value + k * step}) for k in range(3)]
        here, once, twice = (predict_readings(model, d, i, conditions, [each]) for each in ahead)
        for channel, values in found.items():
            difference = (4.0 * once[channel] - 3.0 * here[channel] - twice[channel]) / (2.0 * step)
            size = np.abs(difference).max() + 1e-9 * np.abs(here[channel]).max() / abs(step)
            np.testing.assert_allclose(values[j], difference, rtol=0.0, atol=1e-4 * size, err_msg=f"{name} {channel}")


@pytest.mark.nightly
@needs_compiler
@pytest.mark.parametrize("effect", BUILT_IN, ids=lambda e: e.name)
def test_machine_code_under_an_effect_gives_what_arrays_do_and_a_copy_and_a_fork_do_the_same(
    effect, model, monkeypatch, tmp_path
):
    moved = changed(model, effect)
    states, volts = states_of(moved, 20)
    in_arrays = rates(moved, states, volts)
    libraries = compile_at_once(monkeypatch, tmp_path)
    copied = pickle.loads(pickle.dumps(moved))  # noqa: S301  what was pickled here
    np.testing.assert_array_equal(rates(copied, states, volts), in_arrays)
    assert libraries
    assert all(libraries)
    with ProcessPoolExecutor(1, get_context("fork")) as forked:
        np.testing.assert_array_equal(forked.submit(rates, copied, states, volts).result(), in_arrays)


def test_a_lag_is_outermost_in_whatever_order_effects_are_added(levitation_model):
    both = "eddy_current_lag", "core_saturation"
    one, other = (usually(levitation_model, *order, share=1.0) for order in (both, both[::-1]))
    states, volts = states_of(one, 20)
    np.testing.assert_allclose(*(rates(model, states, volts) for model in (one, other)), rtol=1e-12, atol=1e-12)


def test_a_stop_that_gives_way_pushes_from_its_reach_on_alone(levitation_model):
    """On either side of the kink the effect itself holds, at the kink the plain model."""
    model = usually(levitation_model, "end_stop_contact", share=1.0)
    box = levitation_model.validity
    reach = box.distance_min_m + 0.1 * (box.distance_max_m - box.distance_min_m)
    d, i = reach + np.array([-2e-4, 0.0, 2e-4]), np.full((3, 1), 0.5)
    push = levitation_model.magnetics.force(d, i) - model.magnetics.force(d, i)
    assert push[0] > 1e-6
    np.testing.assert_allclose(push[1:], 0.0, atol=1e-15)


def test_a_point_that_is_no_number_gives_none(levitation_model):
    magnetics = usually(levitation_model, "core_saturation", share=1.0).magnetics
    for count in (1, 2000):
        force = magnetics.force(np.r_[np.nan, np.full(count, 0.02)], np.full((count + 1, 1), 0.5))
        assert np.isnan(force).tolist() == [True, *[False] * count]


def test_an_effect_at_its_null_leaves_the_states_of_others_alone(levitation_model):
    lag = ("eddy_current_lag", {"ring_share": 0.2})
    alone, beside = under_effects(levitation_model, lag), under_effects(levitation_model, ("hysteresis", {}), lag)
    states, volts = states_of(alone, 5)
    np.testing.assert_array_equal(rates(beside, states, volts), rates(alone, states, volts))
