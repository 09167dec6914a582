"""Closed loops of models with effects: the filter that knows them is consistent, the one that does not is not."""

import numpy as np
import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.model.with_effects import with_effects
from femfit.simulation.design import design_loop
from femfit.simulation.loop import ClosedLoop, run_loop
from femfit.simulation.plant import Plant, with_force_scale
from femfit.simulation.sensor import SensorErrors
from femfit.simulation.targets import reference_steps

STEPS = 300


def added(name, **values):
    effect = effect_by_name(name)
    return AddedEffect(effect, effect.null() | values)


EFFECTS = [
    added("eddy_current_lag", ring_share=0.2, diffusion_share=0.1),
    added("hysteresis", width_medium=0.02),
    added("sensor_delay", delay_s=1e-3),
    added("magnet_demagnetisation", loss=0.03),
    added("viscous_friction", damping_per_s=3.0),
    added("driver_gain", gain_error=0.03),
    added("hall_saturation", cubic_loss=0.02),
]


def held(truth, believed, observer, seed=0):
    """Statistics of the second half of 0.15 s at one place, 8 runs."""
    design, own = design_loop(believed), design_loop(truth)
    point = own.points[4]
    reference = reference_steps([point.distance_m], STEPS, truth.sample_time_s, rate=10.0)
    loop = ClosedLoop(
        Plant(own.model),
        own.loop_sensors(),
        SensorErrors(),
        design.observer(observer),
        own.backstepping,
        reference,
    )
    start = np.tile([point.distance_m, 0.0, point.current_A], (8, 1))
    windows = (slice(STEPS // 2, STEPS),)
    return run_loop(loop, start, np.random.default_rng(seed), windows=windows).windows[0]


@pytest.mark.parametrize("observer", ["ukf", "ukf4"])
def test_a_filter_that_knows_the_effects_is_consistent(levitation_model, observer):
    truth = with_effects(levitation_model, EFFECTS)
    found = held(truth, truth, observer)
    # 1200 innovations: three standard errors are 0.12; the converter's rounding is within the noise
    assert 0.82 < found.normalised_innovation_squared.mean() < 1.12
    assert np.abs(found.estimate_bias_m).mean() < 60e-6


def test_a_filter_that_does_not_know_them_sees_the_body_elsewhere(levitation_model):
    truth = with_effects(levitation_model, EFFECTS)
    knowing, ignorant = held(truth, truth, "ukf"), held(truth, levitation_model, "ukf")
    assert ignorant.estimate_rms_m.mean() > 3.0 * knowing.estimate_rms_m.mean()
    assert ignorant.normalised_innovation_squared.mean() > knowing.normalised_innovation_squared.mean()


def test_a_scaled_force_scales_the_plant_with_effects_as_well(levitation_model):
    model = with_effects(levitation_model, EFFECTS)
    start = np.array([[0.022, 0.0, 0.4], [0.022, 0.0, 0.4]])
    plant = Plant(with_force_scale(model, np.array([1.0, 1.1])))
    state = plant.step(plant.start(start), np.full(2, 1.1))
    same = Plant(model)
    np.testing.assert_allclose(state[0], same.step(same.start(start), np.full(2, 1.1))[0], rtol=1e-12)
    assert state[1, 1] < state[0, 1]  # it falls more slowly
