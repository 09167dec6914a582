"""The cause of a lost loop is named with its numbers: authority, sensor, gains."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.simulation.close_loop import close_loop
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment
from femfit.simulation.loop_text import design_lines
from femfit.simulation.lost_loop import LostLoop
from femfit.simulation.why_lost import hardware_limit, reach, short_of_room


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


def test_the_loop_itself_is_held(optical):
    assert run(optical).held == 2


def test_gains_are_named_where_other_gains_hold(optical):
    words = lost(optical, controller="pid", gains={"kp": 40.0, "kd": 1.0}, seconds=1.5)
    assert words.startswith("The gains given")


@pytest.mark.nightly
def test_a_latency_that_the_linear_loop_does_not_bear_comes_before_the_driver(optical):
    """A stronger driver would hold these runs for a while: the loop grows about its rest, and so reaches any limit."""
    words = lost(optical, latency=80, seconds=1.5)
    assert words.startswith("The delay: 40 ms")
    borne = round(float(words.partition("; with ")[2].split(" ms")[0]) / 0.5)
    design = design_loop(optical, latency=80)
    bench, late = (replace(design, latency=samples).bench("ukf") for samples in (borne, borne + 1))
    controller = design.backstepping  # gains that come nearest to a stable loop at this latency
    assert bench.growth(controller) < 0.0 < late.growth(controller)


@pytest.mark.nightly
def test_a_latency_that_a_slower_loop_bears_is_designed_for(optical):
    """20 ms are 0.7 of the time in which the body runs away by a factor e."""
    design = design_loop(optical, latency=40)
    assert design.bench("ukf").growth(design.backstepping) < 0.0
    assert design.bench("ukf").growth(design_loop(optical).backstepping) > 0.0
    assert run(optical, latency=40, seconds=1.5).held == 2


def test_gains_that_are_unstable_with_the_exact_state_are_not_laid_on_the_filter(optical):
    words = lost(optical, controller="pid", bandwidth_rad_s=3000.0, seconds=1.0)
    assert words.startswith("The gains given")


def test_noise_that_fills_the_commands_room_is_named_with_what_it_takes(optical):
    words = lost(with_laser(optical, noise=1.0))
    assert words.startswith("The sensors' noise: laser 1.00 V")
    assert "to the driver's limit" in words


def test_authority_is_named_where_the_force_at_the_limits_does_not_reach(optical):
    """A supply of hardly more than the 0.852 V that hold the body, and noise that asks for more."""
    weak = replace(optical, circuits=(replace(optical.circuit, voltage_max_V=1.02 * 0.852),))
    words = lost(with_laser(weak, noise=60e-3))
    assert words.startswith("The authority: at 22.0 mm")
    assert "brings a body at rest back" in words


def test_a_resting_command_next_to_the_limit_is_named_beside_what_else_helps(optical):
    """1 % above the voltage that holds the body: noise of 5 mV fills it."""
    weak = replace(optical, circuits=(replace(optical.circuit, voltage_max_V=1.01 * 0.852),))
    full = lost_loop(optical)
    assert short_of_room(full) == ""
    loop = lost_loop(with_laser(weak, noise=5e-3))
    left = 1e3 * (weak.circuit.voltage_max_V - loop.design.points[0].commands[0])
    assert f"leaves {left:.2g} mV" in short_of_room(loop)


def test_a_sensor_that_ends_before_the_driver_does_is_named(optical):
    """At 22 mm the laser reads 2.2 V; the driver brings the body back from more than the 0.1 mm up to 2.21 V."""
    assert reach(lost_loop(optical))[1] > 1e-3
    assert hardware_limit(lost_loop(optical)).startswith("The authority")
    words = hardware_limit(lost_loop(with_laser(optical, maximum=2.21)))
    assert words.startswith("The sensors' range")
    assert "farther, although" in words


def test_a_loop_next_to_its_longest_latency_is_called_thin_and_told_what_it_would_keep_without(optical):
    words = {latency: told_margins(optical, latency) for latency in (0, 26)}
    assert "stable with gains" in words[26]
    assert "thin" in words[26]
    assert "without latency" in words[26]
    assert "thin" not in words[0]


def told_margins(model, latency):
    return "\n".join(design_lines(design_loop(model, latency=latency), [("backstepping", "ukf")]))


def lost_loop(model):
    experiment = Experiment("backstepping", "ukf", model.reference_distances_m)
    return LostLoop(design_loop(model), experiment, np.random.default_rng(1), 2, 800, 800, 0, None)
