"""The linear loop: margins against brute force, decay against the simulation, the regulator, the levitation's bound."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from femfit.core.errors import DomainError
from femfit.device.electrics import PositionSensor
from femfit.simulation.adjust import adjusted
from femfit.simulation.controllers import Backstepping, pid_of_parts
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment, run_experiments
from femfit.simulation.linear_loop import LinearController, closed_loop_matrix, linear_controller, linear_plant
from femfit.simulation.margins import gain_margins, phase_and_delay_margin
from femfit.simulation.operating_point import operating_point
from femfit.simulation.sensor import loop_sensors
from support.pickups import searched


@pytest.fixture(scope="module")
def design(levitation_model):
    return design_loop(replace(levitation_model, reference_distances_m=(0.026,)))


@pytest.fixture(scope="module")
def late(levitation_model):
    """A position sensor that is 2.4 samples late, and a command a sample later."""
    laser = PositionSensor(
        name="laser", distances_m=(0.0, 0.1), readings=(0.0, 10.0), noise=2e-3, delay_s=1.2e-3, bits=0
    )
    model = replace(levitation_model, sensor=None, other_sensors=(laser,), reference_distances_m=(0.026,))
    return design_loop(model, latency=1)


def parts(design, name="backstepping", observer="ekf"):
    bench = design.bench(observer)
    k = bench.middle
    linear = joined(design.model, bench.points[k], bench.observers[k], design.controller(name), design.latency)
    return bench.points[k], bench.plants[k], linear


def joined(model, point, observer, controller, latency):
    return LinearController(*observer, *linear_controller(model, point, controller, len(observer[0])), latency)


def test_the_linear_plant_is_the_matrix_exponential_of_the_equations(levitation_model, design):
    point, plant, _ = parts(design)
    whole = np.zeros((4, 4))
    whole[:3, :3], whole[:3, 3:] = point.A, point.B
    exact = scipy.linalg.expm(whole * levitation_model.sample_time_s)
    # four steps of second order over h p = 0.083 are off by (h p)^3/12/16; the distance after a step of the voltage,
    # (h p)^3 at first order, by (h p)^2 of itself at most
    np.testing.assert_allclose(plant.A, exact[:3, :3], rtol=3e-6, atol=1e-7)
    np.testing.assert_allclose(plant.B, exact[:3, 3:], rtol=1e-3)


@pytest.mark.parametrize("name", ["backstepping", "pid", "state-feedback"])
@pytest.mark.parametrize("kind", ["design", "late"])
def test_poles_and_response_of_the_loop_belong_together(request, kind, name):
    """det(I - K G) has the loop's poles as zeros: by Cauchy's argument principle it turns as often as it has poles."""
    loop = request.getfixturevalue(kind)
    _, plant, linear = parts(loop, name)
    poles = np.linalg.eigvals(closed_loop_matrix(plant, linear))
    own = np.linalg.eigvals(closed_loop_matrix(replace(plant, B=0.0 * plant.B), linear))  # with the loop open
    z = 1.3 * np.exp(2j * np.pi * np.arange(20_000) / 20_000)  # outside of all poles
    difference = np.linalg.det(np.eye(1) - linear.response(z) @ plant.response(z, linear.latency))
    rational = np.prod(z[:, None] - poles, axis=1) / np.prod(z[:, None] - own, axis=1)
    np.testing.assert_allclose(difference, rational, rtol=2e-5)


@pytest.mark.parametrize("kind", ["design", pytest.param("late", marks=pytest.mark.nightly)])
def test_a_deviation_of_the_simulated_loop_decays_as_its_slowest_pole_says(request, kind):
    """Without noise, from a small error, on the exact plant with the filter of the linear loop."""
    loop = request.getfixturevalue(kind)
    _, plant, linear = parts(loop)
    poles = np.linalg.eigvals(closed_loop_matrix(plant, linear))
    slowest = np.log(np.abs(poles).max()) / loop.model.sample_time_s
    free = replace(loop.model, sensor=loop.model.sensor and replace(loop.model.sensor, adc_bits=0))
    quiet = replace(loop, model=free)
    experiment = Experiment("backstepping", "ekf", (0.026,), noise_scale=0.0, start_error_m=2e-5)
    (result,) = run_experiments(quiet, [experiment], np.random.default_rng(0), runs=1, steps=1600)
    size = np.abs(result.series.distance_m[:, 0] - 0.026)
    # Five windows, of less than a turn of the slowest pair of poles; rounding leaves 7e-17 m
    window = np.array([size[k : k + 200].max() for k in range(200, 1600, 200)])
    window = window[window > 3e-16][-5:]
    decay = np.polyfit(loop.model.sample_time_s * np.arange(len(window)) * 200, np.log(window), 1)[0]
    assert decay == pytest.approx(slowest, rel=0.15)  # the filter's own gain settles meanwhile


def test_margins_of_a_closed_form():
    """L = 4/(s + 1)^3 has a lag of 180 degrees at w = sqrt(3), where its gain is a half."""
    w = np.geomspace(1e-2, 1e2, 4001)
    L = 4.0 / (1j * w + 1.0) ** 3
    below, above = gain_margins(L)
    assert (below, above) == pytest.approx((0.0, 2.0), rel=1e-4)
    phase, delay = phase_and_delay_margin(w, L)
    crossover = np.sqrt(4.0 ** (2.0 / 3.0) - 1.0)
    assert phase == pytest.approx(np.pi - 3.0 * np.arctan(crossover), rel=1e-4)
    assert delay == pytest.approx(phase / crossover, rel=1e-4)


def test_gains_of_ones_own_take_the_place_of_the_designed_in_both_forms(design):
    other = adjusted(design, "pid", gains={"kp": 400.0})
    assert other.controller("pid").parts["kp"] == pytest.approx(400.0)
    assert other.controller("pid").parts["kd"] == pytest.approx(design.controller("pid").parts["kd"])
    faster = adjusted(design, "backstepping", bandwidth_rad_s=80.0).controller("backstepping")
    assert isinstance(faster, Backstepping)
    assert faster.position_gain == pytest.approx(80.0**2 / 3.0)
    with pytest.raises(DomainError, match="kp, ki, kd, filter_rad_s, current"):
        adjusted(design, "pid", gains={"p": 1.0})
    with pytest.raises(DomainError, match="> 0"):
        adjusted(design, "pid", bandwidth_rad_s=1e9)
    again = pid_of_parts(design.model, **design.controller("pid").parts)
    np.testing.assert_allclose(again.gains, design.controller("pid").gains, rtol=1e-9)
    assert again.filter_pole == pytest.approx(design.controller("pid").filter_pole, rel=1e-9)


@pytest.mark.parametrize("period", [1, 4])
@pytest.mark.parametrize("delay", [0.0, 0.4, 2.0])
def test_the_linear_loop_reads_a_late_or_slow_pickup_coil_as_late_as_it_is(delay, period):
    """The phase of its readings over those of a prompt coil falls with the delay, and half of the samples between."""
    step = searched().sample_time_s
    model = searched(noise=1e-3, delay_s=delay * step, sample_time_s=period * step)
    point = operating_point(model, 2.5e-3)

    def response(one, z):
        sensors = loop_sensors(one, ("search",), {"search": 1e-3}, step)
        return linear_plant(one, point, sensors).response(z)[:, 0, 0]

    angle = 2.0 * np.pi * np.array([0.01, 0.03])
    z = np.exp(1j * angle)
    late = -np.angle(response(model, z) / response(searched(noise=1e-3), z)) / angle
    # A line between two samples turns by its part of a sample to (2 pi 0.03)^2 / 12
    np.testing.assert_allclose(late, delay + 0.5 * (period - 1), atol=3e-3)
