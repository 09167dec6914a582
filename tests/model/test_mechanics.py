"""Springs, load, friction and the direction of weight in the equations that plant and filters share."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.numerics import central_differences
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.estimate.holding import holding_current
from femfit.estimate.noise import default_noise
from femfit.model.dynamics import runge_kutta_step, state_derivative, state_jacobian
from femfit.model.exponential_step import exponential_step
from femfit.model.float_steps import float_step
from femfit.model.with_effects import with_effects
from femfit.simulation.allocation import currents_for_acceleration
from femfit.simulation.controllers import design_backstepping
from femfit.simulation.operating_point import operating_point
from femfit.simulation.targets import Reference

SPRUNG = Mechanics(
    4.35e-3,
    springs=(Spring(0.4, 2e-3, 0.024), ForceTable((0.01, 0.02, 0.04), (2e-3, 1e-3, -3e-3))),
    viscous_N_s_per_m=0.02,
    load_N=-1e-3,
    near_stop=Stop(0.016),
)


def springs_and_load(distance):
    """The force of SPRUNG beside the weight, written out anew."""
    table = 1e-3 if distance == 0.02 else np.interp(distance, [0.01, 0.02, 0.04], [2e-3, 1e-3, -3e-3])
    return 2e-3 - 0.4 * (distance - 0.024) + table - 1e-3


def test_the_acceleration_is_that_of_weight_springs_load_and_friction(levitation_model):
    model = replace(levitation_model, motion=SPRUNG)
    rate = state_derivative(model, np.array([[0.023, 0.1, 0.5]]), np.ones(1))[0, 1]
    force = float(model.force(0.023, 0.5))
    assert rate == pytest.approx(9.80665 + (springs_and_load(0.023) - 0.02 * 0.1 - force) / 4.35e-3, rel=1e-12)


@pytest.mark.parametrize("coulomb", [0.0, 2e-3])
def test_the_jacobian_has_the_slopes_of_springs_and_friction(levitation_model, coulomb):
    model = replace(levitation_model, motion=replace(SPRUNG, coulomb_N=coulomb))
    x, volts = np.array([[0.0231, 1e-4, 0.5], [0.0317, -0.1, 0.9]]), np.full(2, 1.3)
    slopes = central_differences(
        lambda p: state_derivative(model, p, np.tile(volts, 6)), x, np.array([1e-2, 1e-2, 1.0])
    )
    np.testing.assert_allclose(state_jacobian(model, x, volts), slopes, rtol=1e-5, atol=1e-6 * np.abs(slopes).max())


def test_one_step_in_floats_is_the_step_in_arrays(levitation_model):
    model = replace(levitation_model, motion=replace(SPRUNG, springs=SPRUNG.springs[:1]))
    states = np.array([[0.023, 0.1, 0.5], [0.031, -0.2, 0.9]])
    stepped = float_step(model)(states.T.tolist(), 1.2)
    moved = exponential_step(model, states, np.full(2, 1.2), 5e-4)
    np.testing.assert_allclose(np.array(stepped).T, moved, rtol=1e-13)
    assert float_step(replace(model, motion=SPRUNG)) is None  # a table goes by arrays


def test_effects_leave_the_springs_at_work(levitation_model):
    effect = effect_by_name("viscous_friction")
    sprung = with_effects(replace(levitation_model, motion=SPRUNG), [AddedEffect(effect, {"damping_per_s": 3.0})])
    rate = state_derivative(sprung, np.array([[0.023, 0.1, 0.5]]), np.ones(1))[0, 1]
    bare = state_derivative(replace(levitation_model, motion=SPRUNG), np.array([[0.023, 0.1, 0.5]]), np.ones(1))[0, 1]
    assert rate == pytest.approx(bare - 3.0 * 0.1, rel=1e-6)  # of the table under effects


def test_the_body_rests_where_the_force_balances_weight_springs_and_load(levitation_model):
    model = replace(levitation_model, motion=SPRUNG)
    needed = 4.35e-3 * 9.80665 + springs_and_load(0.025)
    assert float(model.force(0.025, holding_current(model, 0.025))) == pytest.approx(needed, rel=1e-9)
    point = operating_point(model, 0.025)
    x = np.array([[0.025, 0.0, point.current_A]])
    assert np.abs(state_derivative(model, x, np.array([point.voltage_V]))).max() < 1e-9
    np.testing.assert_allclose(point.A, state_jacobian(model, x, np.array([point.voltage_V]))[0], rtol=1e-9, atol=1e-9)


def test_a_stiff_spring_makes_the_held_body_stable(levitation_model):
    stiff = replace(levitation_model, motion=Mechanics(4.35e-3, springs=(Spring(10.0, 0.0, 0.025),)))
    assert operating_point(stiff, 0.025).unstable_pole_rad_s == 0.0
    assert operating_point(levitation_model, 0.025).unstable_pole_rad_s > 10.0


def test_the_inverted_acceleration_is_the_one_that_the_plant_has(levitation_model):
    model = replace(levitation_model, motion=SPRUNG)
    current = currents_for_acceleration(model, np.array([0.024]), np.array([1.0]), np.array([0.1]))[:, 0]
    rate = state_derivative(model, np.array([[0.024, 0.1, current[0]]]), np.ones(1))
    assert rate[0, 1] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("gravity", [9.80665, 0.0, -9.80665])
def test_a_body_that_hangs_lies_or_stands_is_held_by_the_same_equations(levitation_model, gravity):
    load = 4.35e-3 * (9.80665 - gravity)  # what a string pulls, so that all of them need the same force
    hanging = replace(levitation_model, misfit=None)
    model = replace(hanging, motion=Mechanics(4.35e-3, gravity, load_N=load))
    assert holding_current(model, 0.024) == pytest.approx(holding_current(hanging, 0.024), rel=1e-12)
    assert default_noise(model).acceleration_density == pytest.approx(
        default_noise(hanging).acceleration_density, rel=1e-12
    )
    point = operating_point(model, 0.024)
    state = np.array([[0.0242, 0.0, point.current_A]])
    rest = Reference(np.asarray(0.024), np.asarray(0.0), np.asarray(0.0))
    commands = [
        design_backstepping(one, [operating_point(one, 0.024)]).command(np.zeros((1, 0)), state, rest)[0]
        for one in (model, hanging)
    ]
    assert commands[0] == pytest.approx(commands[1], rel=1e-9)


def test_a_lying_bodys_friction_effect_is_scaled_by_its_weight_on_earth(levitation_model):
    effect = effect_by_name("coulomb_friction")
    friction = AddedEffect(effect, {"level": 0.5, "breakaway": 0.0, "creep_m_s": 1e-3})
    model = with_effects(replace(levitation_model, motion=Mechanics(4.35e-3, 0.0)), [friction])
    moving, still = (state_derivative(model, np.array([[0.024, v, 0.5]]), np.ones(1))[0, 1] for v in (0.1, 0.0))
    assert moving - still == pytest.approx(-0.5 * 9.80665, rel=1e-9)


def test_dry_friction_stops_a_sliding_body_and_does_not_throw_it_back(levitation_model):
    model = replace(levitation_model, motion=Mechanics(4.35e-3, 0.0, coulomb_N=0.2))
    model = replace(model, magnetics=replace(model.magnetics, spline=nothing(model.magnetics.spline)))
    state = np.array([[0.02, 0.05, 0.0]])  # m v / F: it stops within 1.1 ms, two samples
    for _ in range(20):
        state = runge_kutta_step(model, state, np.zeros(1), model.sample_time_s)
        assert state[0, 1] >= 0.0
    assert state[0, 1] < 1e-5
    stopped = 0.02 + 0.05**2 * 4.35e-3 / (2.0 * 0.2)
    assert state[0, 0] == pytest.approx(stopped, abs=0.05 * 4.0 * model.sample_time_s)  # rounded near rest


def nothing(spline):
    """The spline of 10 mH i^2 / 2: no force."""
    coefficients = np.zeros_like(spline.coefficients)
    coefficients[:, -1] = 0.5 * 0.01 * spline.y_knots[-1] ** 2
    return replace(spline, coefficients=coefficients)
