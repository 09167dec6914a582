"""Where a body begins, its step response, what a drawing's own supply does, and what is called a switching."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.simulation.events import Event
from femfit.simulation.open_loop import motion_at_supply, simulate
from femfit.simulation.profile import Profile
from femfit.simulation.switching import command_before, step_response, switchings
from support.solenoids import NoField, solenoid

STOPS = {"near_stop": Stop(1e-3), "far_stop": Stop(5e-3)}


@pytest.mark.parametrize(
    ("mechanics", "start"),
    [
        ({"springs": (Spring(500.0, 0.0, 2e-3),)} | STOPS, 2e-3),  # between the stops
        ({"springs": (Spring(500.0, 0.0, 2e-3),)}, 2e-3),  # without stops
        ({"springs": (Spring(500.0, 0.0, 2e-3),), "load_N": 0.5} | STOPS, 3e-3),
        ({"springs": (Spring(500.0, 0.0, 9e-3),)} | STOPS, 5e-3),  # pressed to the far stop
        ({"springs": (Spring(500.0, 0.0, 0.0),), "load_N": -1.0} | STOPS, 1e-3),  # to the near one
    ],
)
def test_a_body_begins_where_it_rests_without_current(mechanics, start):
    model = replace(solenoid(), magnetics=NoField(), motion=Mechanics(mass_kg=0.02, gravity_m_s2=0.0, **mechanics))
    found = simulate(model, voltage_V=0.0, duration_s=0.01)
    assert found.table["distance_m"] == pytest.approx(np.full(2001, start), abs=1e-9)
    assert not found.switchings


@pytest.mark.parametrize("ratio", [0.3, 0.6, 1.0, 3.0])
def test_rise_overshoot_and_settling_of_a_second_order_system(ratio):
    time = np.linspace(0.0, 80.0, 400_001)
    poles = np.roots([1.0, 2.0 * ratio * (1.0 + 1e-9), 1.0])
    way = 1.0 - ((poles[1] * np.exp(poles[0] * time) - poles[0] * np.exp(poles[1] * time)) / (poles[1] - poles[0])).real
    found = step_response(time, 5e-3 - 2e-3 * way)
    assert (found.start_m, found.end_m) == pytest.approx((5e-3, 3e-3), rel=1e-4)
    closed = np.exp(-np.pi * ratio / np.sqrt(1.0 - ratio**2)) if ratio < 1.0 else 0.0
    assert found.overshoot == pytest.approx(closed, abs=1e-4)
    outside = time[np.abs(way - 1.0) > 0.02]
    assert found.settling_s == pytest.approx(outside[-1], abs=1e-3)
    assert time[np.argmax(way > 0.9)] - time[np.argmax(way > 0.1)] == pytest.approx(found.rise_s, abs=1e-3)


def test_what_does_not_move_settle_or_ends_on_a_stop_has_no_step_response():
    time = np.linspace(0.0, 1.0, 1001)
    assert step_response(time, 1e-3 * time) is None
    assert step_response(time, np.full(1001, 1e-3)) is None
    springs = {"springs": (Spring(500.0, 0.0, 3e-3),), "viscous_N_s_per_m": 5.0}
    free = replace(solenoid(), motion=Mechanics(mass_kg=0.02, gravity_m_s2=0.0, **springs))
    stopped = replace(free, motion=Mechanics(mass_kg=0.02, gravity_m_s2=0.0, **springs, near_stop=Stop(2.9e-3)))
    assert simulate(free, current_A=0.4, duration_s=0.3).step is not None
    assert simulate(stopped, current_A=1.0, duration_s=0.3).step is None


def test_a_body_that_begins_between_its_stops_is_not_said_to_drop_out():
    model = replace(solenoid(), motion=Mechanics(mass_kg=0.02, gravity_m_s2=9.81, **STOPS))
    found = simulate(model, voltage_V=0.0, start_m=2e-3, duration_s=0.1)
    assert [one.kind for one in found.switchings] == ["to_far"]
    assert found.switchings[0].started_s == pytest.approx(found.switchings[0].command_s)


SPRING = Spring(20.0, 0.05, 5e-3)


def on_springs(**changes):
    return replace(
        solenoid(), motion=Mechanics(**{"mass_kg": 0.02, "gravity_m_s2": 0.0, "springs": (SPRING,)} | changes)
    )


def test_a_body_between_stops_is_switched_on_and_off():
    model = on_springs(near_stop=Stop(0.5e-3, 0.2), far_stop=Stop(5e-3, 0.2))
    found = motion_at_supply(model)
    assert [one.kind for one in found.switchings] == ["pull_in", "drop_out"]
    assert found.profile.value.tolist() == [model.circuit.voltage_max_V, 0.0]
    alone = simulate(model, voltage_V=model.circuit.voltage_max_V, duration_s=found.profile.time_s[1])
    assert found.switchings[0].reached_s == pytest.approx(alone.switchings[0].reached_s, rel=1e-9)
    assert found.switchings[1].rested_s < found.duration_s


def test_a_body_on_springs_gets_a_step_that_it_can_follow_between_its_stops():
    model = on_springs(springs=(Spring(2e3, 0.0, 3e-3),), viscous_N_s_per_m=5.0)
    found = motion_at_supply(model)
    assert found.step is not None
    assert not found.left_domain
    parts = [model.circuit.voltage_max_V / 2.0**k for k in range(7)]
    assert found.profile.value[0] in parts
    assert found.table["distance_m"][-1] < found.table["distance_m"][0]
    model = on_springs(
        springs=(Spring(80.0, 0.0, 3e-3),), viscous_N_s_per_m=2.0, near_stop=Stop(2e-3), far_stop=Stop(4e-3)
    )
    found = motion_at_supply(model)
    assert found.step is not None
    assert found.profile.value[0] < model.circuit.voltage_max_V


def test_where_the_supply_moves_nothing_it_is_said_to_stay_or_there_is_no_such_motion():
    strong = on_springs(springs=(Spring(500.0, 1.0, 5e-3),), near_stop=Stop(0.5e-3), far_stop=Stop(5e-3))
    motion = motion_at_supply(strong)
    assert not motion.switchings
    assert motion.table["distance_m"] == pytest.approx(5e-3)
    levitated = replace(solenoid(), motion=Mechanics(mass_kg=0.02))
    amplifier = on_springs(near_stop=Stop(0.5e-3), far_stop=Stop(5e-3))
    amplifier = replace(amplifier, circuits=(replace(amplifier.circuit, drive=Drive("current")),))
    assert motion_at_supply(levitated) is None
    assert motion_at_supply(amplifier) is None
    assert motion_at_supply(replace(solenoid(), motion=None)) is None


STEP = (Profile("voltage", np.array([0.0]), np.array([12.0])),)


@pytest.mark.parametrize(
    ("names", "kinds"),
    [
        (("starts", "hits_near", "hits_near", "rests_near", "starts", "hits_far"), ["pull_in", "drop_out"]),
        # thrown from stop to stop, as a vibration motor is
        (("starts", "hits_near", "hits_far", "hits_near"), ["pull_in", "to_far", "to_near"]),
        # a stop that gives way has no rest
        (("starts", "hits_near", "leaves_near", "hits_far"), ["pull_in", "drop_out"]),
        # an event that is no contact changes nothing
        (("starts", "hits_near", "current_leaves_domain", "hits_far"), ["pull_in", "to_far"]),
        # from between the stops
        (("starts", "hits_far"), ["to_far"]),
    ],
)
def test_a_body_switches_where_it_rested_on_the_stop_that_it_leaves(names, kinds):
    events = [Event(1e-3 * k, name, 1e-3, 0.3, 0.5) for k, name in enumerate(names, start=1)]
    begun_at = None if names == ("starts", "hits_far") else "far"
    assert [one.kind for one in switchings(events, begun_at, STEP)] == kinds


def chopped(begin, end, period=1e-4, share=0.8, high=24.0, low=0.0):
    """Times and values of pulses from begin to end."""
    starts = np.arange(begin, end - 0.5 * period, period)
    return [pair for start in starts for pair in ((start, high), (start + share * period, low))]


def held(points):
    time, value = zip(*points, strict=True)
    return [Profile("voltage", np.array(time), np.array(value))]


def test_pauses_rises_and_single_steps_are_told_from_chopping():
    steps = held([(0.0, 0.0), (0.01, 12.0), (0.05, 0.0)])
    assert [command_before(steps, time) for time in (0.005, 0.012, 0.06)] == [0.0, 0.01, 0.05]
    points = [(0.0, 0.0), *chopped(0.01, 0.03), (0.04, 12.0)]
    assert command_before(held(points), 0.02003) == pytest.approx(0.01)
    last_off = chopped(0.01, 0.03)[-1][0]
    assert command_before(held(points), 0.032) == pytest.approx(last_off)  # the driver stays off from here
    assert command_before(held(points), 0.041) == pytest.approx(0.04)
    points = [(0.0, 0.0), (0.002, 24.0), *((t + 0.004, v) for t, v in [(0.0, 0.0), *chopped(1e-4, 2e-3, share=0.3)])]
    assert command_before(held(points), 0.00513) == pytest.approx(0.002)
    points = chopped(0.0, 0.02)
    assert command_before(held(points), 0.01503, after=0.0101) == pytest.approx(0.0102, abs=1e-4)


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_chopping_is_one_command_from_its_beginning(noise):
    points = [(0.0, 24.0), *chopped(0.001, 0.02, low=18.0), (0.02, 0.0)]
    random = np.random.default_rng(1)
    points = [(time, value + noise * random.uniform(-1.0, 1.0)) for time, value in points]
    assert command_before(held(points), 0.01503) == 0.0  # the first level is that of the pulses
    assert command_before(held(points), 0.0207) == pytest.approx(0.02)
