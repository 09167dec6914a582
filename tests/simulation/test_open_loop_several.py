"""Open loops of several circuits and none; where a body begins, its step response, and what is called a switching."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import TableError, UsageError
from femfit.device.electrics import Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.fit.build import fit_model
from femfit.report.motion_figures import open_loop_figure
from femfit.simulation.events import Event
from femfit.simulation.open_loop import motion_at_supply, simulate
from femfit.simulation.open_result import step_response, switchings
from femfit.simulation.profile import Profile, read_profiles
from support.bearing import table_of
from support.halves import NAMES, cut_in_two
from support.parts import with_circuit, with_motion
from support.solenoids import HELD, NoField, solenoid
from support.switching import pulse

DRIVES = {
    "bridge": (None, "voltage", 12.0),
    "diode": (Drive(diode_V=0.7), "voltage", 12.0),
    "amplifier": (Drive("current"), "current", 0.595),
    "amplifier of a bandwidth": (Drive("current", bandwidth_Hz=300.0), "current", 0.595),
}


@pytest.mark.parametrize("name", DRIVES)
def test_two_halves_switch_as_the_whole_coil(name):
    """With something in series, and each half with half of the voltage, or the same current."""
    drive, kind, on = DRIVES[name]
    whole = with_circuit(solenoid(drive=drive), inductance_H=2e-3)
    one = simulate(whole, drive=pulse(kind, on, end=0.08), duration_s=0.15)
    command = pulse(kind, 0.5 * on if kind == "voltage" else on, end=0.08)
    two = simulate(cut_in_two(whole), drive=dict.fromkeys(NAMES, command), duration_s=0.15)
    assert [(s.kind, s.bounces) for s in two.switchings] == [(s.kind, s.bounces) for s in one.switchings]
    for mine, other in zip(two.switchings, one.switchings, strict=True):
        assert mine.reached_s == pytest.approx(other.reached_s, rel=1e-6)
        assert mine.seating_velocity_m_s == pytest.approx(other.seating_velocity_m_s, rel=1e-5)
    for column in NAMES:
        # Where a bounce falls a little earlier or later, after many of them, currents differ for that long
        np.testing.assert_allclose(two.table[f"current_{column}_A"], one.table["current_A"], atol=2e-5)
    flux = two.table["flux_linkage_inner_Wb"] + two.table["flux_linkage_outer_Wb"]
    np.testing.assert_allclose(flux, one.table["flux_linkage_Wb"], atol=2e-6)
    np.testing.assert_allclose(two.table["distance_m"], one.table["distance_m"], atol=1e-7)
    for part in ("source_J", "copper_J", "diode_J", "impact_J", "magnetic_J"):
        assert getattr(two.energy, part) == pytest.approx(getattr(one.energy, part), rel=1e-5, abs=1e-9)
    for motion in (one, two):
        assert abs(motion.energy.remainder_J) < 1e-6 * motion.energy.supplied_J


SPRUNG = {
    "gravity_m_s2": -9.81,
    "springs": [{"stiffness_N_per_m": 4e5, "preload_N": 0.0, "distance_m": 0.5e-3}],
    "viscous_N_s_per_m": 20.0,
    "near_stop": {"distance_m": 0.25e-3, "restitution": 0.3},
    "far_stop": {"distance_m": 0.75e-3, "restitution": 0.3},
}


@pytest.fixture(scope="module")
def bearing():
    """Two unlike circuits, one with a bridge and one with a diode and a choke, between two stops."""
    entry = {**table_of().manifest["actuator"], "mechanics": SPRUNG}
    return fit_model(table_of(entry=entry)).model


def test_all_energy_of_two_unlike_circuits_is_accounted_for(bearing):
    drive = {"lower": pulse("voltage", 1.5, -1.5, 0.01), "upper": pulse("voltage", 1.2)}
    motion = simulate(bearing, drive=drive, duration_s=0.06, outside="extrapolate")
    assert abs(motion.energy.remainder_J) < 1e-6 * motion.energy.supplied_J
    assert motion.energy.diode_J > 0.0
    i, t = (motion.table[f"current_{name}_A"] for name in ("lower", "upper")), motion.table["time_s"]
    copper = sum(ohm * np.trapezoid(one**2, t) for ohm, one in zip((1.5, 1.2), i, strict=True))
    assert motion.energy.copper_J == pytest.approx(copper, rel=1e-3)
    assert motion.table["current_upper_A"].min() == 0.0  # its diode lets no current back
    assert np.ptp(motion.table["distance_m"]) > 1e-5


def test_a_current_in_one_circuit_drives_the_other_ones_diode():
    """Held still, two coils are a transformer: with one switched off, the other's current goes on by the diode."""
    model = cut_in_two(solenoid(replace(HELD, springs=(Spring(0.0, 50.0),)), Drive(diode_V=0.2)))
    motion = simulate(model, drive={"inner": pulse("voltage", 6.0)}, duration_s=0.05)
    outer, time = motion.table["current_outer_A"], motion.table["time_s"]
    assert np.all(outer[time < 0.0199] == 0.0)  # a rising current drives it against its diode
    assert outer.max() > 0.05  # a falling one through it
    assert {("current_stops", name) for name in NAMES} <= {(event.name, event.circuit) for event in motion.events}
    assert abs(motion.energy.remainder_J) < 1e-6 * motion.energy.supplied_J


def test_an_amplifier_feels_what_the_other_circuit_induces(bearing):
    """One current is held while the other's voltage steps; the voltage that holds it follows the mutual inductance."""
    amplifier = replace(bearing.circuits[1], drive=Drive("current"), voltage_min_V=-24.0)
    model = replace(bearing, circuits=(bearing.circuits[0], amplifier), motion=Mechanics(1e6, 0.0))
    motion = simulate(model, voltage_V={"lower": 3.0}, current_A={"upper": 0.0}, duration_s=0.002, start_m=0.5e-3)
    inductance = model.inductance(0.5e-3, [0.0, 0.0])
    rate = 3.0 / inductance[0, 0]  # of the first moment
    assert motion.table["voltage_upper_V"][0] == pytest.approx(inductance[0, 1] * rate, rel=1e-6)
    np.testing.assert_allclose(motion.table["current_upper_A"], 0.0, atol=1e-12)


def test_a_command_and_the_end_of_the_domain_name_their_circuits(bearing):
    for voltage, named in ((2.0, "lower, upper"), ({"sideways": 2.0}, "sideways")):
        with pytest.raises(UsageError, match=named):
            simulate(bearing, voltage_V=voltage)
    motion = simulate(bearing, voltage_V={"lower": 40.0}, duration_s=1e-3)
    assert "lower" in motion.notes[0]
    motion = simulate(bearing, voltage_V={"lower": 24.0}, duration_s=0.05)
    assert motion.left_domain[0][0] == "current_lower"
    assert motion.events[-1].current_A[0] == pytest.approx(2.0, rel=1e-5)


def test_a_table_commands_each_circuit_by_its_column(bearing, tmp_path):
    path = tmp_path / "drive.csv"
    path.write_text("time_s,voltage_lower_V,voltage_upper_V\n0,1,0.5\n0.002,0,0.5\n0.004,0,0\n")
    found = read_profiles(path, ("lower", "upper"))
    assert (found["lower"].at(0.001), found["upper"].at(0.003)) == (1.0, 0.5)
    motion = simulate(bearing, drive=path)
    assert motion.end_s == 0.004
    assert len(open_loop_figure(motion).axes) == 5
    path.write_text("time_s,voltage_lower_V,current_lower_A\n0,1,0.5\n")
    with pytest.raises(TableError, match="voltage_upper_V"):
        read_profiles(path, ("lower", "upper"))


STOPS = {"near_stop": Stop(1e-3), "far_stop": Stop(5e-3)}


@pytest.mark.parametrize(
    ("free_m", "load_N", "stops", "start"),
    [(2e-3, 0.0, STOPS, 2e-3), (2e-3, 0.0, {}, 2e-3), (2e-3, 0.5, STOPS, 3e-3),
     (9e-3, 0.0, STOPS, 5e-3), (0.0, -1.0, STOPS, 1e-3)],
    ids=["between the stops", "without stops", "under a load", "pressed to the far stop", "to the near one"],
)  # fmt: skip
def test_a_body_begins_where_it_rests_without_current(free_m, load_N, stops, start):
    motion = Mechanics(0.02, 0.0, springs=(Spring(500.0, 0.0, free_m),), load_N=load_N, **stops)
    model = replace(solenoid(motion), magnetics=NoField())
    found = simulate(model, voltage_V=0.0, duration_s=0.01)
    assert found.table["distance_m"] == pytest.approx(np.full(2001, start), abs=1e-9)
    assert not found.switchings


def on_springs(**changes):
    usual = {"mass_kg": 0.02, "gravity_m_s2": 0.0, "springs": (Spring(20.0, 0.05, 5e-3),)}
    return solenoid(Mechanics(**usual | changes))


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
    free = on_springs(springs=(Spring(500.0, 0.0, 3e-3),), viscous_N_s_per_m=5.0)
    assert simulate(free, current_A=0.4, duration_s=0.3).step is not None
    assert simulate(with_motion(free, near_stop=Stop(2.9e-3)), current_A=1.0, duration_s=0.3).step is None


def test_a_body_that_begins_between_its_stops_is_not_said_to_drop_out():
    found = simulate(solenoid(Mechanics(0.02, 9.81, **STOPS)), voltage_V=0.0, start_m=2e-3, duration_s=0.1)
    assert [one.kind for one in found.switchings] == ["to_far"]
    assert found.switchings[0].started_s == pytest.approx(found.switchings[0].command_s)


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
    soft = {"springs": (Spring(80.0, 0.0, 3e-3),), "viscous_N_s_per_m": 2.0}
    free, stopped = map(motion_at_supply, (model, on_springs(**soft, near_stop=Stop(2e-3), far_stop=Stop(4e-3))))
    assert free.step is not None
    assert stopped.step is not None
    assert not free.left_domain
    supply = model.circuit.voltage_max_V
    assert free.profile.value[0] in [supply / 2.0**k for k in range(7)]
    assert free.table["distance_m"][-1] < free.table["distance_m"][0]
    assert stopped.profile.value[0] < supply


def test_where_the_supply_moves_nothing_it_is_said_to_stay_or_there_is_no_such_motion():
    stopped = on_springs(near_stop=Stop(0.5e-3), far_stop=Stop(5e-3))
    motion = motion_at_supply(with_motion(stopped, springs=(Spring(500.0, 1.0, 5e-3),)))
    assert not motion.switchings
    assert motion.table["distance_m"] == pytest.approx(5e-3)
    levitated, amplified = solenoid(Mechanics(0.02)), with_circuit(stopped, drive=Drive("current"))
    for model in (levitated, amplified, replace(solenoid(), motion=None)):
        assert motion_at_supply(model) is None


STEP = (Profile("voltage", np.array([0.0]), np.array([12.0])),)


SWITCHINGS = {
    "with a rest": ("far", "starts hits_near hits_near rests_near starts hits_far", "pull_in drop_out"),
    "thrown from stop to stop": ("far", "starts hits_near hits_far hits_near", "pull_in to_far to_near"),
    "on a stop that gives way": ("far", "starts hits_near leaves_near hits_far", "pull_in drop_out"),
    "with an event that is no contact": ("far", "starts hits_near current_leaves_domain hits_far", "pull_in to_far"),
    "from between the stops": (None, "starts hits_far", "to_far"),
}


@pytest.mark.parametrize("name", SWITCHINGS)
def test_a_body_switches_where_it_rested_on_the_stop_that_it_leaves(name):
    begun_at, names, kinds = SWITCHINGS[name]
    events = [Event(1e-3 * k, name, 1e-3, 0.3, 0.5) for k, name in enumerate(names.split(), start=1)]
    assert [one.kind for one in switchings(events, begun_at, STEP)] == kinds.split()
