"""Margins of linear loops: against the characteristic polynomial, kept by a default design, bounded by zeros."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_lyapunov
from scipy.signal import ss2tf

import femfit as ff
from femfit.device.electrics import CurrentSensor
from femfit.model.json_file import write_model
from femfit.simulation.design import design_loop
from femfit.simulation.linear_loop import LinearController, LinearPlant
from femfit.simulation.margins import margins, worst_of
from support.command import worked
from support.readings import LASER_10_V

STEP = 1e-3


def sampled(A, B):
    """A continuous plant whose first state is read, held over the samples."""
    n = len(A)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = A, B
    whole = expm(STEP * block)
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


def swept(plant, controller):
    """The factors next to one at which the loop turns unstable, by bisection; 0 and infinity where there are none."""
    found = []
    for direction, none in ((-1.0, 0.0), (1.0, np.inf)):
        factors = np.exp(direction * np.linspace(0.0, np.log(1e3), 400))
        lost = [f for f in factors if largest_root(plant, controller, f) >= 1.0 + 1e-12]
        if not lost:
            found.append(none)
            continue
        outer, inner = lost[0], lost[0] * np.exp(-direction * np.log(1e3) / 399)
        for _ in range(40):
            middle = np.sqrt(outer * inner)
            outer, inner = (middle, inner) if largest_root(plant, controller, middle) >= 1.0 else (outer, middle)
        found.append(outer)
    return found


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
    assert (found.gain_below, found.gain_above) == pytest.approx(swept(plant, controller), rel=5e-3)


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


def test_gains_of_several_circuits_are_scaled_together():
    """Two circuits that share one force: either alone may fail, while both together bear no less than one of both."""
    one = pid(9000.0, 0.0, 120.0, 1500.0)
    shared = replace(UNSTABLE, B=np.hstack([UNSTABLE.B, UNSTABLE.B]))
    halves = replace(one, G=np.zeros((1, 2)), N=0.5 * np.vstack([one.N, one.N]), D=0.5 * np.vstack([one.D, one.D]))
    single = margins(UNSTABLE, one, STEP, np.ones(1))
    both = margins(shared, halves, STEP, np.ones(2))
    assert both.gain_below == pytest.approx(single.gain_below, rel=5e-3)
    assert both.gain_above == pytest.approx(single.gain_above, rel=5e-3)
    assert both.gain_below > 0.1


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


def test_a_filter_that_allows_for_an_error_of_the_commands_pays_for_the_margin_with_little(sensed):
    design = design_loop(sensed)
    trusting = replace(design, command_error=1.0)
    assert design.command_error > 1.0
    assert design.settled_errors[0] < 1.5 * trusting.settled_errors[0]
    for name in ("backstepping", "state-feedback"):
        assert worst_of(design.margins(name, "ekf")).modulus > worst_of(trusting.margins(name, "ekf")).modulus


@pytest.mark.nightly
@pytest.mark.parametrize("thin", [True, False])
def test_the_rigs_thin_loop_is_called_thin(levitation_model, sensed, tmp_path, thin):
    write_model(levitation_model if thin else sensed, tmp_path / "rig.json")
    options = ("--runs", 1, "--seconds", 0.05, "--controller", "backstepping")
    assert ("thin: " in worked("simulate", tmp_path / "rig.json", *options).stdout) == thin
