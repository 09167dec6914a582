"""What a drawing's own supply does: a solenoid switches, a body on springs answers a step, a levitated one nothing."""

from dataclasses import replace

import pytest

from femfit.device.electrics import Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.simulation.open_loop import simulate
from femfit.simulation.supply import motion_at_supply
from support.solenoids import solenoid

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
    assert "stays at 5.00 mm" in str(motion_at_supply(strong))


def test_what_nothing_keeps_in_place_or_a_current_feeds_has_no_such_motion():
    levitated = replace(solenoid(), motion=Mechanics(mass_kg=0.02))
    amplifier = on_springs(near_stop=Stop(0.5e-3), far_stop=Stop(5e-3))
    amplifier = replace(amplifier, circuits=(replace(amplifier.circuit, drive=Drive("current")),))
    assert motion_at_supply(levitated) is None
    assert motion_at_supply(amplifier) is None
    assert motion_at_supply(replace(solenoid(), motion=None)) is None
