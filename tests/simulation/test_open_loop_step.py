"""Where a body begins, its step response against closed forms, and what a drawing's own supply does."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.simulation.open_loop import simulate
from femfit.simulation.supply import motion_at_supply
from femfit.simulation.switching import step_response
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


def test_what_has_not_settled_or_does_not_move_has_no_step_response():
    time = np.linspace(0.0, 1.0, 1001)
    assert step_response(time, 1e-3 * time) is None
    assert step_response(time, np.full(1001, 1e-3)) is None


def test_a_motion_onto_a_stop_is_no_step_response():
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


def test_a_body_on_springs_gets_a_step_that_it_can_follow():
    model = on_springs(springs=(Spring(2e3, 0.0, 3e-3),), viscous_N_s_per_m=5.0)
    found = motion_at_supply(model)
    assert found.step is not None
    assert not found.left_domain
    parts = [model.circuit.voltage_max_V / 2.0**k for k in range(7)]
    assert found.profile.value[0] in parts
    assert found.table["distance_m"][-1] < found.table["distance_m"][0]


def test_a_body_that_springs_hold_between_its_stops_is_stepped_and_not_driven_onto_them():
    model = on_springs(
        springs=(Spring(80.0, 0.0, 3e-3),), viscous_N_s_per_m=2.0, near_stop=Stop(2e-3), far_stop=Stop(4e-3)
    )
    found = motion_at_supply(model)
    assert found.step is not None
    assert found.profile.value[0] < model.circuit.voltage_max_V


def test_a_body_that_the_supply_is_too_weak_for_is_said_to_stay():
    strong = on_springs(springs=(Spring(500.0, 1.0, 5e-3),), near_stop=Stop(0.5e-3), far_stop=Stop(5e-3))
    motion = motion_at_supply(strong)
    assert not motion.switchings
    assert motion.table["distance_m"] == pytest.approx(5e-3)


def test_what_nothing_keeps_in_place_or_a_current_feeds_has_no_such_motion():
    levitated = replace(solenoid(), motion=Mechanics(mass_kg=0.02))
    amplifier = on_springs(near_stop=Stop(0.5e-3), far_stop=Stop(5e-3))
    amplifier = replace(amplifier, circuits=(replace(amplifier.circuit, drive=Drive("current")),))
    assert motion_at_supply(levitated) is None
    assert motion_at_supply(amplifier) is None
    assert motion_at_supply(replace(solenoid(), motion=None)) is None
