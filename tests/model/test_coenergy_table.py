"""The co-energy under effects as a table: the effects' own numbers, one co-energy, and the effects where it ends."""

import dataclasses

import numpy as np
import pytest

from femfit.effects.catalogue import BUILT_IN, effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.stages import changed_coenergy
from femfit.model.coenergy_table import CoenergyTable
from femfit.model.dynamics import state_derivative
from femfit.model.with_effects import base_coenergy, nominal_of, with_effects
from support.added_effects import usual
from support.one_current import flat

STATIC = [effect for effect in BUILT_IN if effect.coenergy is not None and effect.memory is None]


def without_lag(effect):
    """The effect, which does not tell how its states act."""
    return dataclasses.replace(effect, memory=dataclasses.replace(effect.memory, lag=None))


def tables(model, effect):
    """The effect's own co-energy, and the table of it."""
    at = Conditions(nominal_of(model), running=True, coil_temperature_C=45.0, magnet_temperature_C=35.0)
    exact = changed_coenergy(base_coenergy(model), [usual(effect)], at)
    return exact, CoenergyTable(exact, at.nominal, hall=True)


def anywhere(model, count, reach=0.1):
    """Points all over the box and a little beyond it."""
    box, rng = model.validity, np.random.default_rng(7)
    low = np.array([box.distance_min_m, box.current_min_A])
    span = np.array([box.distance_max_m, box.current_max_A]) - low
    return (low + span * rng.uniform(-reach, 1.0 + reach, (count, 2))).T


@pytest.mark.parametrize("effect", STATIC, ids=lambda e: e.name)
def test_the_table_is_the_effect(effect, levitation_model):
    d, i = anywhere(levitation_model, 4000)
    exact, table = tables(levitation_model, effect)
    wanted, found = exact(d, i, 2, 2), table(d, i, 2, 2)
    # The tolerances of the table at its own checks, and as much again between them; relative to the points' largest
    for order, tolerance in {
        (1, 0, 0): 2e-6,
        (0, 1, 0): 2e-6,
        (1, 1, 0): 2e-5,
        (0, 2, 0): 2e-5,
        (0, 0, 1): 2e-6,
    }.items():
        scale = np.abs(wanted.derivative(*order)).max()
        assert np.abs(found.derivative(*order) - wanted.derivative(*order)).max() <= tolerance * scale


@pytest.mark.parametrize("order", [(0, 0), (1, 2), (2, 1), (0, 3)])
def test_beyond_the_grid_and_at_a_kink_the_effect_itself_is_evaluated(order, levitation_model):
    exact, table = tables(levitation_model, effect_by_name("end_stop_contact"))
    box = levitation_model.validity
    kink = box.distance_min_m + 0.1 * (box.distance_max_m - box.distance_min_m)  # the stop's usual reach
    d = np.array([0.5 * box.distance_min_m, kink, 2.0 * box.distance_max_m, 0.02])
    i = np.array([0.3, 0.3, 0.3, 3.0 * box.current_max_A])
    np.testing.assert_array_equal(table(d, i, *order).coefficients, exact(d, i, *order).coefficients)


def test_force_and_flux_linkage_of_the_table_derive_from_one_coenergy(levitation_model):
    magnetics, h = with_effects(levitation_model, [usual(effect_by_name("core_saturation"))]).magnetics, 1e-6
    d, i = anywhere(levitation_model, 200, reach=0.0)
    rise = flat(magnetics).coenergy(d + h, i) - flat(magnetics).coenergy(d - h, i)
    # Where table and effect meet, W' steps by 1e-12 J, over 2 um
    np.testing.assert_allclose(flat(magnetics).force(d, i), -rise / (2 * h), atol=1e-6)
    across = flat(magnetics).force(d, i + h) - flat(magnetics).force(d, i - h)
    along = flat(magnetics).flux_linkage(d + h, i) - flat(magnetics).flux_linkage(d - h, i)
    # Two mixed second differences of one W': equal but for rounding and such a step of its derivatives
    np.testing.assert_allclose(across, -along, atol=1e-4 * np.abs(across).max())


def test_points_give_the_same_bits_alone_and_together(levitation_model):
    _, table = tables(levitation_model, effect_by_name("core_saturation"))
    d, i = anywhere(levitation_model, 9)
    together = table(d, i, 1, 2).coefficients
    alone = [table(d[k : k + 1], i[k : k + 1], 1, 2).coefficients for k in range(9)]
    np.testing.assert_array_equal(np.concatenate(alone, axis=-1), together)


def test_a_point_that_is_no_number_gives_none(levitation_model):
    _, table = tables(levitation_model, effect_by_name("core_saturation"))
    assert np.isnan(table(np.array([np.nan]), np.array([0.5]), 1, 1).derivative(1, 0)).all()


@pytest.mark.parametrize("name", ["eddy_current_lag", "hysteresis"])
def test_the_lag_of_states_is_what_their_coenergy_does(name, levitation_model):
    added = usual(effect_by_name(name))
    memory, at = added.effect.memory, Conditions(nominal_of(levitation_model))
    d, i = np.array([0.018, 0.024, 0.033]), np.array([0.3, 0.6, 1.0])
    states = {name: np.array([0.05, -0.1, 0.08]) * (1 + k) for k, name in enumerate(memory.names)}
    lag = memory.lag(at, added.parameters)
    current, taper = (sum(lag[name][k] * states[name] for name in memory.names) for k in range(2))
    moved = base_coenergy(levitation_model)(d, i - current, 1, 3)
    linkage = moved.along_current()
    expected = moved.truncated(1, 2) - (taper / 2.0) * (linkage * linkage)
    acting = changed_coenergy(base_coenergy(levitation_model), [added], dataclasses.replace(at, memory=states))(
        d, i, 1, 2
    )
    np.testing.assert_allclose(acting.coefficients[0], expected.coefficients[0], rtol=1e-12)


@pytest.mark.parametrize("names", [("eddy_current_lag",), ("hysteresis",), ("hysteresis", "eddy_current_lag")])
def test_states_whose_action_is_not_told_step_as_those_whose_is(names, levitation_model):
    model = with_effects(levitation_model, [usual(effect_by_name(name)) for name in names])
    untold = [dataclasses.replace(one, effect=without_lag(one.effect)) for one in model.effects]
    other = with_effects(levitation_model, untold)
    assert model.dynamics.lags is not None
    assert other.dynamics.lags is None
    rng = np.random.default_rng(3)
    d, i = anywhere(levitation_model, 20, reach=0.0)
    own = rng.uniform(-0.3, 0.3, (20, len(model.memory_names)))
    x = np.column_stack([d, rng.normal(0.0, 0.1, 20), i, own])
    found, wanted = (state_derivative(one, x, np.full(20, 1.5)) for one in (model, other))
    # Central differences over 1e-3 of functions that the states bend over one
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())


def test_a_lag_is_outermost_in_whatever_order_effects_are_added(levitation_model):
    both = [usual(effect_by_name(name)) for name in ("eddy_current_lag", "core_saturation")]
    one, other = (with_effects(levitation_model, order) for order in (both, both[::-1]))
    d, i = anywhere(levitation_model, 20, reach=0.0)
    x = np.column_stack([d, np.full(20, 0.1), i, np.full((20, 2), 0.1)])
    np.testing.assert_array_equal(*(state_derivative(model, x, np.full(20, 1.5)) for model in (one, other)))
