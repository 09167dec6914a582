"""Closed loops of the analytic levitation_model."""

import numpy as np
import pytest

from femfit.estimate.levitation import levitation_process
from femfit.estimate.noise import default_noise, initial_covariance
from femfit.estimate.unscented import UnscentedFilter
from femfit.simulate.backstepping import design_backstepping
from femfit.simulate.loop import ClosedLoop, run_loop
from femfit.simulate.observer import FilterObserver
from femfit.simulate.operating_point import operating_point
from femfit.simulate.outcome import LoopOutcome
from femfit.simulate.pid import design_pid
from femfit.simulate.plant import Plant
from femfit.simulate.reference import reference_rate, reference_steps
from femfit.simulate.sensor import SensorErrors

NOISE_V = 3.2e-3


def ukf_loop(levitation_model, controller, steps=3000, noise=NOISE_V, **errors):
    process = levitation_process(levitation_model, noise=default_noise(levitation_model, noise_V=noise))
    observer = FilterObserver(UnscentedFilter(process), initial_covariance())
    targets = levitation_model.reference_distances_m
    reference = reference_steps(
        targets, steps, levitation_model.sample_time_s, reference_rate(levitation_model, targets)
    )
    return ClosedLoop(
        Plant(levitation_model),
        levitation_model.sensor,
        SensorErrors(noise_V=noise, **errors),
        observer,
        controller,
        reference,
    )


def start(levitation_model, runs, distance=0.022):
    return np.tile([distance, 0.0, operating_point(levitation_model, distance).current_A], (runs, 1))


@pytest.fixture(scope="module")
def controllers(levitation_model):
    points = [operating_point(levitation_model, d) for d in np.linspace(0.022, 0.030, 5)]
    return {
        "backstepping": design_backstepping(levitation_model, points),
        "pid": design_pid(levitation_model, points[2]),
    }


@pytest.mark.parametrize("name", ["backstepping", "pid"])
def test_the_filter_holds_the_magnet_over_8_mm_steps_at_the_papers_noise(levitation_model, controllers, name):
    loop = ukf_loop(levitation_model, controllers[name])
    result = run_loop(loop, start(levitation_model, 8), np.random.default_rng(1), supported_steps=200)
    assert set(result.outcomes()) == {LoopOutcome.HELD}
    worst = np.abs(result.series.distance_m - loop.reference.distance[:, None]).max()
    assert worst < 1e-3  # an eighth of the step, and far from the box's ends


def test_the_same_seed_gives_the_same_numbers(levitation_model, controllers):
    loop = ukf_loop(levitation_model, controllers["backstepping"], steps=300)
    first, second, other = (run_loop(loop, start(levitation_model, 2), np.random.default_rng(s)) for s in (3, 3, 4))
    np.testing.assert_array_equal(first.series.distance_m, second.series.distance_m)
    assert np.any(first.series.distance_m != other.series.distance_m)
