"""Which ways to a stop are pull-in and drop-out, and which change of a command moved the body, chopped or not."""

import numpy as np
import pytest

from femfit.simulation.events import Event
from femfit.simulation.open_loop import simulate
from femfit.simulation.profile import Profile
from femfit.simulation.switching import command_before, switchings
from support.solenoids import solenoid

STEP = (Profile("voltage", np.array([0.0]), np.array([12.0])),)


def kinds(*names, begun_at="far"):
    events = [Event(1e-3 * k, name, 1e-3, 0.3, 0.5) for k, name in enumerate(names, start=1)]
    return [one.kind for one in switchings(events, begun_at, STEP)]


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (("starts", "hits_near", "hits_near", "rests_near", "starts", "hits_far"), ["pull_in", "drop_out"]),
        # thrown from stop to stop, as a vibration motor is
        (("starts", "hits_near", "hits_far", "hits_near"), ["pull_in", "to_far", "to_near"]),
        # a stop that gives way has no rest
        (("starts", "hits_near", "leaves_near", "hits_far"), ["pull_in", "drop_out"]),
        # an event that is no contact changes nothing
        (("starts", "hits_near", "current_leaves_domain", "hits_far"), ["pull_in", "to_far"]),
    ],
)
def test_a_body_switches_where_it_rested_on_the_stop_that_it_leaves(names, found):
    assert kinds(*names) == found


def test_a_body_that_begins_in_the_air_reaches_a_stop():
    assert kinds("starts", "hits_far", begun_at=None) == ["to_far"]


def chopped(begin, end, period=1e-4, share=0.8, high=24.0, low=0.0):
    """Times and values of pulses from begin to end."""
    starts = np.arange(begin, end - 0.5 * period, period)
    return [pair for start in starts for pair in ((start, high), (start + share * period, low))]


def held(points):
    time, value = zip(*points, strict=True)
    return [Profile("voltage", np.array(time), np.array(value))]


def test_a_single_step_is_its_own_command():
    steps = held([(0.0, 0.0), (0.01, 12.0), (0.05, 0.0)])
    assert [command_before(steps, time) for time in (0.005, 0.012, 0.06)] == [0.0, 0.01, 0.05]


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_chopping_is_one_command_from_its_beginning(noise):
    points = [(0.0, 24.0), *chopped(0.001, 0.02, low=18.0), (0.02, 0.0)]
    random = np.random.default_rng(1)
    points = [(time, value + noise * random.uniform(-1.0, 1.0)) for time, value in points]
    assert command_before(held(points), 0.01503) == 0.0  # the first level is that of the pulses
    assert command_before(held(points), 0.0207) == pytest.approx(0.02)


def test_a_pause_before_the_chopping_and_the_end_of_it_are_no_chopping():
    points = [(0.0, 0.0), *chopped(0.01, 0.03), (0.04, 12.0)]
    assert command_before(held(points), 0.02003) == pytest.approx(0.01)
    last_off = chopped(0.01, 0.03)[-1][0]
    assert command_before(held(points), 0.032) == pytest.approx(last_off)  # the driver stays off from here
    assert command_before(held(points), 0.041) == pytest.approx(0.04)


def test_a_rise_is_the_command_where_a_current_is_held_by_chopping():
    points = [(0.0, 0.0), (0.002, 24.0), *((t + 0.004, v) for t, v in [(0.0, 0.0), *chopped(1e-4, 2e-3, share=0.3)])]
    assert command_before(held(points), 0.00513) == pytest.approx(0.002)


def test_what_was_commanded_before_the_last_motion_did_not_cause_the_next():
    points = chopped(0.0, 0.02)
    assert command_before(held(points), 0.01503, after=0.0101) == pytest.approx(0.0102, abs=1e-4)


def test_a_chopped_supply_switches_as_late_as_its_mean():
    """The current follows the mean voltage, for a period is far below its time constant."""
    model = solenoid()
    period, share = 1e-4, 0.97
    mean = simulate(model, voltage_V=11.64, duration_s=0.07).switchings[0]
    pulses = simulate(model, drive=held(chopped(0.0, 0.07, period, share, 12.0))[0], duration_s=0.07).switchings[0]
    assert pulses.command_s == 0.0
    assert pulses.switching_time_s == pytest.approx(mean.switching_time_s, abs=3.0 * period)
