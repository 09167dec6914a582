"""What a loop says of its progress, of why it is lost, of its margins and of innovations beside their band."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.estimate.noise import ConsistencyBand, default_noise
from femfit.model.validity import ProcessNoise
from femfit.simulation.close_loop import close_loop
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment, LoopRuns
from femfit.simulation.summary import HoldRow, consistency
from femfit.simulation.why_lost import bearable, hardware_limit
from femfit.simulation.words import sentence
from support.expected import unmentioned


def hold(quality):
    """A row of a filter at rest whose predictions are this far from what it expects."""
    nan = float("nan")
    return HoldRow("pid", "ukf", 0.02, nan, 1e-5, nan, nan, quality, ConsistencyBand(0.95, 1.05), 16, 16)


@pytest.mark.parametrize(
    ("qualities", "praised", "cautious"),
    [((1.0, 0.99), True, False), ((0.66, 0.69), False, True), ((1.5, 1.6), False, False), ((1.0, 0.9), False, False)],
)
def test_innovations_below_their_band_are_called_those_of_a_cautious_filter(qualities, praised, cautious):
    said = sentence("loop", "consistency", consistency([hold(each) for each in qualities]))
    assert ("knows its own error" in said) == praised
    assert ("too cautious" in said) == cautious


ONE = {"estimator": "ukf", "runs": 6, "seconds": 0.25, "targets_m": (0.022,), "rng": 1}


@pytest.mark.parametrize(("scale", "below"), [pytest.param(1e-2, False, marks=pytest.mark.nightly), (40.0, True)])
def test_errors_that_a_plant_does_not_have_are_named_as_the_cause_of_small_innovations(levitation_model, scale, below):
    """Process noise of forty times the model's own misfit, or none to speak of, in a plant without any."""
    own = default_noise(levitation_model)
    noise = ProcessNoise(own.acceleration_density * scale**2, float(own.voltage_V) * scale)
    loop = ff.close_loop(replace(levitation_model, process_noise=noise), **ONE)
    assert (loop.normalised_innovation_squared < loop.innovation_band.lower) == below
    assert loop.expects_absent_errors == below
    assert not replace(loop, plant="another").expects_absent_errors
    assert len(str(replace(loop, plant="another")).splitlines()) == len(str(loop).splitlines()) - below


def told(model, **options):
    parts = []
    close_loop(model, runs=1, targets_m=(0.022,), progress=lambda *part: parts.append(part), **options)
    return parts


def test_a_loop_counts_its_samples_up_to_the_last(levitation_model):
    parts = told(levitation_model, controller="pid", seconds=0.1)
    names, done, total = zip(*parts, strict=True)
    assert set(names) == {"closed loop"}
    assert len(set(total)) == 1
    assert list(done) == sorted(set(done))
    assert total[0] - 50 <= done[-1] < total[0]  # it reports at every 50th sample


def run(model, **options):
    options = {"controller": "backstepping", "estimator": "ukf", "runs": 2, "seconds": 0.4, **options}
    return close_loop(model, **options)


def lost(model, **options):
    loop = run(model, **options)
    assert loop.held < loop.runs
    return loop.advice


def with_laser(model, **fields):
    (laser,) = model.other_sensors
    return replace(model, other_sensors=(replace(laser, **fields),))


def of_rig(_, rig):
    return rig


def of_laser(noise=None, voltage_max_V=None):
    """The rig with a laser of so much noise, on such a supply; 0.852 V hold the body."""

    def made(optical, _):
        model = optical if noise is None else with_laser(optical, noise=noise)
        highest = voltage_max_V or model.circuit.voltage_max_V
        return replace(model, circuits=(replace(model.circuit, voltage_max_V=highest),))

    return made


DIRECT = {"estimator": "direct", "noise": 0.012, "controller": None, "targets_m": (0.022,), "runs": 4, "seconds": 0.2}
"""Without a filter the body falls."""
FILTERED = DIRECT | {"estimator": "ukf"}
CAUSES = {
    "gains": (
        of_laser(), {"controller": "pid", "gains": {"kp": 40.0, "kd": 1.0}, "seconds": 1.5}, "Without the gains given",
    ),
    "gains that are unstable with the exact state": (
        of_laser(), {"controller": "pid", "bandwidth_rad_s": 3000.0, "seconds": 1.0}, "Without the gains given",
    ),
    "noise that fills the commands": (of_laser(1.0), {}, "The sensors' noise: laser 1.00 V", "to the driver's limit"),
    "authority": (
        of_laser(60e-3, 1.02 * 0.852), {}, "The authority: at 22.0 mm", "brings a body at rest back",
    ),
    "a fault that was asked for": (of_rig, FILTERED | {"noise": None, "stuck_after_s": 0.05}, "", "sensor stuck"),
    "no filter": (of_rig, DIRECT, "The sensors' noise"),
    "noise beside the signal of 0.9 V": (of_rig, FILTERED | {"noise": 1.0}, "", "sensors' noise", "!Use a filter"),
    "a fault where the loop is lost without it": (
        of_rig, DIRECT | {"stuck_after_s": 0.05}, "The sensors' noise", "sensor stuck",
    ),
}  # fmt: skip
LONG = (
    "gains",
    "authority",
    "a fault that was asked for",
    "no filter",
    "noise beside the signal of 0.9 V",
    "a fault where the loop is lost without it",
)


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.nightly] * (n in LONG)) for n in CAUSES])
def test_a_lost_loop_names_its_cause_with_its_numbers_and_never_what_is_done_already(name, optical, levitation_model):
    make, options, first, *words = CAUSES[name]
    said = lost(make(optical, levitation_model), **options)
    assert said.startswith(first)
    assert not unmentioned(words, said)


def test_the_loop_itself_is_held(optical):
    assert run(optical).held == 2


@pytest.mark.nightly
def test_a_latency_that_the_linear_loop_does_not_bear_comes_before_the_driver(optical):
    """A stronger driver would hold these runs for a while: the loop grows about its rest, and so reaches any limit."""
    loop = run(optical, latency=80, seconds=1.5)
    assert (loop.cause.code, loop.cause.numbers) == ("asked-for", {"asked_for": ("latency",)})
    assert "Without the latency the same runs hold" in loop.advice


@pytest.mark.nightly
def test_a_latency_that_a_slower_loop_bears_is_designed_for(optical):
    """20 ms are 0.7 of the time in which the body runs away by a factor e."""
    design = design_loop(optical, latency=40)
    assert design.bench("ukf").growth(design.controller("backstepping")) < 0.0
    assert design.bench("ukf").growth(design_loop(optical).controller("backstepping")) > 0.0
    assert run(optical, latency=40, seconds=1.5).held == 2


@pytest.mark.nightly
def test_a_sensor_that_ends_before_the_driver_does_is_named(optical):
    """At 22 mm the laser reads 2.2 V; the driver brings the body back from more than the 0.1 mm up to 2.21 V."""
    assert bearable(lost_loop(optical))["reach_m"][1] > 1e-3
    assert hardware_limit(lost_loop(optical)).code == "authority"
    blinded = lost_loop(with_laser(optical, maximum=2.21))
    words = sentence("lost", "advice", blinded, hardware_limit(blinded))
    assert words.startswith("The sensors' range")
    assert "farther, although" in words


def lost_loop(model):
    experiment = Experiment("backstepping", "ukf", model.reference_distances_m)
    return LoopRuns(design_loop(model), experiment, np.random.default_rng(1), 2, 800, 800, 0, None)
