"""A spring as an effect is the spring of the mechanics."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.mechanics import ForceTable, Spring
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.model.dynamics import state_derivative
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of, with_effects
from support.solenoids import solenoid

D, CURRENT = np.array([0.5e-3, 2e-3, 5.5e-3]), np.array([0.2, 1.0, 1.7])


def with_springs(*springs):
    model = solenoid()
    return replace(model, motion=replace(model.motion, springs=springs))


def spring_effect(model, spring):
    nominal = nominal_of(model)
    push = float(spring.preload_N - spring.stiffness_N_per_m * (nominal.distance_max_m - spring.distance_m))
    parameters = {
        "stiffness": spring.stiffness_N_per_m / nominal.stiffness_N_per_m,
        "preload": push / nominal.force_N,
    }
    return AddedEffect(effect_by_name("spring"), parameters)


def accelerations(model):
    return state_derivative(model, np.stack([D, 0.0 * D, CURRENT], axis=-1), 20.0 * CURRENT)[:, 1]


def test_a_spring_that_is_missing_acts_on_readings_and_motion_as_one_that_is_drawn():
    spring, plain = Spring(200.0, 0.1, 4e-3), with_springs()
    effect = [spring_effect(plain, spring)]
    at = Conditions(nominal_of(plain))
    change = (
        predict_readings(plain, D, CURRENT, at, effect)["force_N"] - predict_readings(plain, D, CURRENT, at)["force_N"]
    )
    np.testing.assert_allclose(change, -(0.1 - 200.0 * (D - 4e-3)), rtol=1e-12)
    # The co-energy under effects is a table of fourth order in the distance
    np.testing.assert_allclose(
        accelerations(with_effects(plain, effect)), accelerations(with_springs(spring)), rtol=1e-6
    )


@pytest.mark.parametrize(
    ("name", "parameters", "true"),
    [
        # The same free length, 4.5 mm
        ("spring_stiffness", lambda _: {"stiffness_error": 0.2}, Spring(240.0, 0.0, 4.5e-3)),
        ("spring_preload", lambda n: {"preload": 0.05 / n.force_N}, Spring(200.0, 0.15, 4e-3)),
    ],
)
def test_a_drawn_spring_that_is_off_moves_the_body_as_the_true_one(name, parameters, true):
    drawn = with_springs(Spring(200.0, 0.1, 4e-3))
    changed = with_effects(drawn, [AddedEffect(effect_by_name(name), parameters(nominal_of(drawn)))])
    np.testing.assert_allclose(accelerations(changed), accelerations(with_springs(true)), rtol=1e-6)


@pytest.mark.parametrize(
    "springs",
    [
        (Spring(1600.0, 0.0, 4e-3),),
        (Spring(200.0, 0.1, 4e-3), Spring(300.0, -0.5, 2e-3)),
        (Spring(200.0, 0.1, 4e-3), ForceTable((0.2e-3, 3e-3, 7e-3), (3.0, 1.0, -0.5))),
    ],
)
def test_stiffer_springs_keep_their_free_lengths(springs):
    drawn = with_springs(*springs)
    at, stiffer = (
        Conditions(nominal_of(drawn)),
        AddedEffect(effect_by_name("spring_stiffness"), {"stiffness_error": 0.3}),
    )
    true, alone = (predict_readings(drawn, D, CURRENT, at, effects)["force_N"] for effects in ([stiffer], []))
    np.testing.assert_allclose(true - alone, -0.3 * drawn.motion.push_of_springs(D), rtol=1e-12, atol=1e-13)


def test_a_force_sensor_that_holds_the_body_reads_the_drawn_spring_as_well():
    drawn = with_springs(Spring(200.0, 0.1, 4e-3))
    at, carried = Conditions(nominal_of(drawn)), AddedEffect(effect_by_name("spring_in_force"), {"share": 1.0})
    read, alone = (predict_readings(drawn, D, CURRENT, at, effects)["force_N"] for effects in ([carried], []))
    np.testing.assert_allclose(read - alone, -(0.1 - 200.0 * (D - 4e-3)), rtol=1e-12)
