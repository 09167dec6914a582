"""The linear loop: margins against brute force, decay against the simulation, what a default design keeps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_lyapunov
from scipy.signal import ss2tf

import femfit as ff
from femfit.core.errors import DomainError, UsageError
from femfit.device.electrics import CurrentSensor
from femfit.simulation.controllers import Backstepping
from femfit.simulation.design import CONTROLLERS, adjusted, design_loop
from femfit.simulation.experiment import Experiment, LoopRuns
from femfit.simulation.linear_loop import LinearController, LinearPlant, closed_loop_matrix, linear_plant
from femfit.simulation.loop import run_loop
from femfit.simulation.margins import gain_margins, margins, phase_and_delay_margin, worst_of
from femfit.simulation.operating_point import operating_point
from femfit.simulation.plant import loop_sensors
from support.readings import LASER_10_V
from support.solenoids import searched


@pytest.fixture(scope="module")
def design(levitation_model):
    return design_loop(replace(levitation_model, reference_distances_m=(0.026,)))


@pytest.fixture(scope="module")
def late(levitation_model):
    """A position sensor that is 2.4 samples late, and a command a sample later."""
    laser = replace(LASER_10_V, delay_s=1.2e-3, bits=0)
    model = replace(levitation_model, sensor=None, other_sensors=(laser,), reference_distances_m=(0.026,))
    return design_loop(model, latency=1)


def parts(design, name="backstepping", observer="ekf"):
    bench = design.bench(observer)
    rest = bench.rests[len(bench.rests) // 2]
    return rest.point, rest.plant, rest.closed_by(design.controller(name), design.latency)


def test_the_linear_plant_is_the_matrix_exponential_of_the_equations(levitation_model, design):
    point, plant, _ = parts(design)
    exact = expm(np.block([[point.A, point.B], [np.zeros((1, 4))]]) * levitation_model.sample_time_s)
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


def test_a_deviation_of_the_simulated_loop_decays_as_its_slowest_pole_says(design):
    """Without noise, from a small error, on the exact plant with the filter of the linear loop."""
    step, (point, plant, linear) = design.model.sample_time_s, parts(design)
    slowest = np.log(np.abs(np.linalg.eigvals(closed_loop_matrix(plant, linear))).max()) / step
    noisy = LoopRuns(design, Experiment("backstepping", "ekf", (0.026,)), None, 1, 1600, 1600, 0).loop
    sensors = tuple(replace(sensor, reading=replace(sensor.reading, noise=0.0, bits=0)) for sensor in noisy.sensors)
    off, filter_ = np.array([2e-5, 0.0, 0.0]), noisy.observer
    # It believes the body to be at rest
    observer = SimpleNamespace(start=lambda mean: filter_.start(mean - off), update=filter_.update, step=filter_.step)
    start = point.state + off
    quiet = replace(noisy, sensors=sensors, observer=observer)
    (result,) = run_loop(quiet, start[None], np.random.default_rng(0))
    size = np.abs(result.series.distance_m[:, 0] - 0.026)
    # Five windows, of less than a turn of the slowest pair of poles; rounding leaves 7e-17 m
    window = np.array([size[k : k + 200].max() for k in range(200, 1600, 200)])
    window = window[window > 3e-16][-5:]
    decay = np.polyfit(step * np.arange(len(window)) * 200, np.log(window), 1)[0]
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


def test_the_margin_of_a_loop_that_moves_more_slowly_than_a_ten_thousandth_of_its_sampling():
    """x' = a x + u with u = -k x crosses at sqrt(k^2 - a^2), where its lag is pi - atan(w/a)."""
    a, k = 0.02, 0.0212
    slow = sampled(np.array([[a]]), np.array([1.0]))
    kept = margins(slow, pid(k, 0.0, 0.0, 400.0), STEP, np.ones(1))
    assert kept.phase_rad == pytest.approx(np.arctan(np.sqrt(k**2 - a**2) / a), rel=1e-3)
    assert kept.largest_gain == pytest.approx(k / a, rel=1e-2)
    assert kept.uses_sensors


def test_a_stable_body_whose_loop_has_no_gain_has_no_phase_margin():
    """Of 400 N/m, with 100 of the loop: a quarter at rest, where the gain of a damped body is largest."""
    idle = margins(DAMPED, pid(100.0, 0.0, 0.0, 400.0), STEP, np.ones(1))
    assert idle.stable
    assert idle.largest_gain == pytest.approx(0.25, rel=1e-3)
    assert not idle.uses_sensors
    assert margins(DAMPED, pid(800.0, 0.0, 8.0, 400.0), STEP, np.ones(1)).uses_sensors


def test_gains_of_ones_own_take_the_place_of_the_designed_in_both_forms(design):
    assert [design.controller(name=name).name for name in CONTROLLERS] == list(CONTROLLERS)
    drawn, other = (one.controller("pid") for one in (design, adjusted(design, "pid", gains={"kp": 400.0})))
    assert (other.parts["kp"], other.parts["kd"]) == pytest.approx((400.0, drawn.parts["kd"]))
    faster = adjusted(design, "backstepping", bandwidth_rad_s=80.0).controller("backstepping")
    assert isinstance(faster, Backstepping)
    assert faster.position == pytest.approx(80.0**2 / 3.0)
    with pytest.raises(UsageError, match="kp, ki, kd, filter_rad_s, current"):
        adjusted(design, "pid", gains={"p": 1.0})
    with pytest.raises(DomainError, match="> 0"):
        adjusted(design, "pid", bandwidth_rad_s=1e9)
    again = other.with_parts(drawn.parts)
    np.testing.assert_allclose(again.gains, drawn.gains, rtol=1e-9)
    assert again.filter_pole == pytest.approx(drawn.filter_pole, rel=1e-9)


@pytest.mark.parametrize("period", [1, 4])
@pytest.mark.parametrize("delay", [0.0, 0.4, 2.0])
def test_the_linear_loop_reads_a_late_or_slow_pickup_coil_as_late_as_it_is(delay, period):
    """The phase of its readings over those of a prompt coil falls with the delay, and half of the samples between."""
    step = searched().sample_time_s
    model = searched(noise=1e-3, delay_s=delay * step, sample_time_s=period * step)
    point = operating_point(model, 2.5e-3)

    def response(one, z):
        sensors = loop_sensors(one, {"search": 1e-3}, step)
        return linear_plant(one, point, sensors).response(z)[:, 0, 0]

    angle = 2.0 * np.pi * np.array([0.01, 0.03])
    z = np.exp(1j * angle)
    late = -np.angle(response(model, z) / response(searched(noise=1e-3), z)) / angle
    # A line between two samples turns by its part of a sample to (2 pi 0.03)^2 / 12
    np.testing.assert_allclose(late, delay + 0.5 * (period - 1), atol=3e-3)


STEP = 1e-3


def sampled(A, B):
    """A continuous plant whose first state is read, held over the samples."""
    n = len(A)
    whole = expm(STEP * np.block([[A, B[:, None]], [np.zeros((1, n + 1))]]))
    return LinearPlant(whole[:n, :n], whole[:n, n:], np.eye(n)[:1, None], np.array([1e-6]))


def pid(kp, ki, kd, rate):
    """u = -(kp + ki / s + kd s / (1 + s / rate)) y, behind an observer that gives y itself."""
    poles = np.array([1.0, np.exp(-rate * STEP)])
    M, E = np.diag(poles), np.ones((2, 1))
    N, D = np.array([[-ki * STEP, kd * rate * (1.0 - poles[1])]]), np.array([[-(kp + kd * rate)]])
    used = [0, 1] if ki else [1]
    none, all_of_it = np.zeros((1, 1)), np.ones((1, 1))
    return LinearController(none, none, all_of_it, M[np.ix_(used, used)], E[used], N[:, used], D, 0)


def largest_root(plant, controller, factor):
    """Of the loop's characteristic polynomial with the commands times a factor."""
    above, below = ss2tf(plant.A, plant.B, plant.C[:, 0], np.zeros((1, 1)))
    own_above, own_below = ss2tf(controller.M, controller.E, controller.N, controller.D)
    closed = np.polysub(np.polymul(below, own_below), factor * np.polymul(above[0], own_above[0]))
    return np.abs(np.roots(closed)).max()


DAMPED = sampled(np.array([[0.0, 1.0], [-400.0, -30.0]]), np.array([0.0, 1.0]))
UNSTABLE = sampled(np.array([[0.0, 1.0], [2500.0, 0.0]]), np.array([0.0, 1.0]))
SLOW = sampled(np.array([[0.0, 1.0], [-100.0, -4.0]]), np.array([0.0, 1.0]))
LOOPS = {
    "lightly damped body, an integral alone": (SLOW, pid(0.0, 22.0, 0.0, 400.0)),
    "damped body, with an integral": (DAMPED, pid(200.0, 4000.0, 8.0, 400.0)),
    "damped body, integral that leads": (DAMPED, pid(-300.0, 2000.0, 20.0, 400.0)),
    "damped body, pushed away": (DAMPED, pid(-300.0, 0.0, 20.0, 400.0)),
    "unstable body, with an integral": (UNSTABLE, pid(9000.0, 60000.0, 120.0, 1500.0)),
    "unstable body, without an integral": (UNSTABLE, pid(9000.0, 0.0, 120.0, 1500.0)),
}


@pytest.mark.parametrize("name", LOOPS)
def test_gain_margins_are_where_the_swept_loop_turns_unstable(name):
    plant, controller = LOOPS[name]
    assert largest_root(plant, controller, 1.0) < 1.0
    found = margins(plant, controller, STEP, np.array([1.0]))
    assert found.stable
    # 600 frequencies over four decades are 1.5 % apart; between them the response is taken as a straight line
    low, high = max(0.995 * found.gain_below, 1e-3), min(1.005 * found.gain_above, 1e3)
    within = np.geomspace(max(1.005 * found.gain_below, 1e-3), min(0.995 * found.gain_above, 1e3), 200)
    assert max(largest_root(plant, controller, factor) for factor in within) < 1.0 + 1e-12
    assert (largest_root(plant, controller, low) > 1.0) == (found.gain_below > 0.0)
    assert (largest_root(plant, controller, high) > 1.0) == np.isfinite(found.gain_above)


@pytest.mark.parametrize("name", ["damped body, with an integral", "unstable body, without an integral"])
def test_the_share_of_noise_is_that_of_lyapunovs_equation(name):
    plant, own = LOOPS[name]
    c, room = plant.C[:, 0], 0.02
    whole = np.block([[plant.A + plant.B @ own.D @ c, plant.B @ own.N], [own.E @ c, own.M]])
    enters = np.concatenate([plant.B @ own.D, own.E])
    states = solve_discrete_lyapunov(whole, plant.noise[0] ** 2 * enters @ enters.T, method="bilinear")
    told = np.concatenate([own.D @ c, own.N], axis=1)
    variance = (told @ states @ told.T + plant.noise[0] ** 2 * own.D @ own.D.T).item()
    found = margins(plant, own, STEP, np.array([room])).noise_share
    # The sum over frequencies that are 1.5 % apart
    assert found == pytest.approx(np.sqrt(variance) / room, rel=5e-3)


def test_gains_of_two_circuits_that_share_a_force_are_those_of_one_beside_the_other():
    """Each half of a command bears twice the factor of the whole, less one, while the other half stays as it is."""
    one = pid(9000.0, 0.0, 120.0, 1500.0)
    shared = replace(UNSTABLE, B=np.hstack([UNSTABLE.B, UNSTABLE.B]))
    halves = replace(one, G=np.zeros((1, 2)), N=0.5 * np.vstack([one.N, one.N]), D=0.5 * np.vstack([one.D, one.D]))
    single = margins(UNSTABLE, one, STEP, np.ones(1))
    both = margins(shared, halves, STEP, np.ones(2))
    assert both.gain_below == pytest.approx(max(0.0, 2.0 * single.gain_below - 1.0), rel=5e-3)
    assert both.gain_above == pytest.approx(2.0 * single.gain_above - 1.0, rel=5e-3)


@pytest.fixture(scope="module")
def sensed(levitation_model):
    """The rig with a laser of 20 um and an ammeter of 4 mA in place of its Hall element."""
    ammeter = CurrentSensor(name="ammeter", noise=4e-3, circuit=levitation_model.circuit.name)
    return replace(levitation_model, sensor=None, other_sensors=(LASER_10_V, ammeter))


def test_a_loop_of_good_sensors_keeps_45_degrees_and_half_a_modulus_margin(sensed):
    loop = ff.close_loop(sensed, estimator="ukf", runs=2, seconds=0.2)
    kept = worst_of(loop.design.margins(loop.experiment.controller, "ukf"))
    assert np.degrees(kept.phase_rad) >= 45.0
    assert kept.modulus >= 0.5
    assert kept.noise_share <= 0.1
    assert not kept.thin
    assert loop.held == 2


def test_a_filter_that_allows_for_an_error_of_the_commands_leaves_more_margin(sensed):
    design = design_loop(sensed)
    trusting = replace(design, command_error=1.0)
    assert design.command_error > 1.0
    for name in ("backstepping", "state-feedback"):
        assert worst_of(design.margins(name, "ekf")).modulus > worst_of(trusting.margins(name, "ekf")).modulus
