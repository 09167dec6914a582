"""Motion in open loop: closed forms of fall, spring, friction and rebounds; the fixed-step plant; eddy currents."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import Drive
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
from femfit.estimate.kalman_filter import kalman_filter
from femfit.model.with_effects import with_effects
from femfit.simulation.open_loop import simulate
from femfit.simulation.plant import Plant
from femfit.simulation.profile import Profile
from support.added_effects import added, usually
from support.eddies import magnets_alone, with_eddies
from support.halves import cut_in_two
from support.parts import with_circuit, with_motion
from support.readings import LASER
from support.solenoids import HELD, NoField, inductance, searched, solenoid
from support.steps import runge_kutta_step
from support.switching import pulse


def body(**mechanics):
    """A body of 20 g without field, between 0.1 and 6 mm, level unless it is said otherwise."""
    motion = Mechanics(**{"mass_kg": 0.02, "gravity_m_s2": 0.0} | mechanics)
    return replace(solenoid(motion), magnetics=NoField())


def test_a_body_falls_by_half_g_t_squared_and_swings_on_a_spring_as_a_cosine():
    found = simulate(body(gravity_m_s2=9.80665), voltage_V=0.0, start_m=1e-3, duration_s=0.03).table
    np.testing.assert_allclose(found["distance_m"], 1e-3 + 0.5 * 9.80665 * found["time_s"] ** 2, atol=1e-12)
    np.testing.assert_allclose(found["velocity_m_s"], 9.80665 * found["time_s"], atol=1e-10)
    found = simulate(body(springs=(Spring(80.0, 0.0, 3e-3),)), voltage_V=0.0, start_m=1e-3, duration_s=0.4).table
    swing = 3e-3 - 2e-3 * np.cos(np.sqrt(80.0 / 0.02) * found["time_s"])
    np.testing.assert_allclose(found["distance_m"], swing, atol=1e-9)  # of 4 mm, over four periods


def test_dry_friction_takes_the_same_length_from_every_swing_until_the_body_sticks():
    stiffness, friction, amplitude = 80.0, 0.02, 2e-3
    model = body(springs=(Spring(stiffness, 0.0, 3e-3),), coulomb_N=friction)
    motion = simulate(model, voltage_V=0.0, start_m=3e-3 - amplitude, duration_s=0.4)
    shift, half = friction / stiffness, np.pi / np.sqrt(stiffness / 0.02)
    swings = int((amplitude - shift) / (2.0 * shift)) + 1  # until the spring is weaker than the friction
    stuck = [event for event in motion.events if event.name == "sticks"]
    assert [event.time_s for event in stuck] == [pytest.approx(swings * half, rel=1e-7)]
    remaining = (amplitude - 2.0 * shift * swings) * (-1.0) ** (swings + 1)
    assert motion.table["distance_m"][-1] == pytest.approx(3e-3 + remaining, abs=1e-9)
    assert motion.table["velocity_m_s"][-1] == 0.0


@pytest.mark.parametrize("restitution", [0.3, 0.8])
def test_a_bouncing_body_hits_after_times_of_a_geometric_series(restitution):
    height = 4e-3
    model = body(gravity_m_s2=-9.80665, near_stop=Stop(1e-3, restitution))
    motion = simulate(model, voltage_V=0.0, start_m=1e-3 + height, duration_s=0.4)
    hits = np.array([event.time_s for event in motion.events if event.name == "hits_near"])
    fall = np.sqrt(2.0 * height / 9.80665)
    series = fall * (1.0 + 2.0 * np.cumsum(np.r_[0.0, restitution ** np.arange(1, len(hits))]))
    np.testing.assert_allclose(hits, series, rtol=1e-6)
    speeds = np.array([abs(event.velocity_m_s) for event in motion.events if event.name == "hits_near"])
    np.testing.assert_allclose(speeds, 9.80665 * fall * restitution ** np.arange(len(hits)), rtol=1e-4)
    end = fall * (1.0 + restitution) / (1.0 - restitution)
    assert motion.switchings[0].rested_s == pytest.approx(end, rel=2e-3)  # rebounds below 1e-7 of the travel are cut
    assert motion.energy.impact_J == pytest.approx(0.02 * 9.80665 * height, rel=1e-9)


@pytest.mark.parametrize("restitution", [0.05, 0.3, 0.9])
def test_a_stop_that_gives_way_returns_the_speed_that_it_is_said_to(restitution):
    model = body(gravity_m_s2=-9.80665, near_stop=Stop(1e-3, restitution, 1e10))
    motion = simulate(model, voltage_V=0.0, start_m=5e-3, duration_s=0.05)
    hit, left = (next(e for e in motion.events if e.name == name) for name in ("hits_near", "leaves_near"))
    # The weight of 0.2 N slows a body that creeps out of the stop by less
    assert left.velocity_m_s == pytest.approx(-restitution * hit.velocity_m_s, rel=0.01)
    assert abs(motion.energy.remainder_J) < 1e-6 * motion.energy.supplied_J


@pytest.mark.parametrize("spring", [Spring(200.0, 0.1, 4e-3), ForceTable((0.0, 2e-3, 4e-3), (3.0, 0.5, 0.1))])
def test_a_body_pressed_on_its_stop_rests_until_the_force_exceeds_that_of_the_spring(spring):
    stops = {"near_stop": Stop(0.2e-3, 0.2), "far_stop": Stop(4e-3, 0.2)}
    motion = simulate(solenoid(Mechanics(0.025, 0.0, springs=(spring,), **stops)), voltage_V=12.0)
    start = next(event for event in motion.events if event.name == "starts")
    current = np.sqrt(2.0 * 0.1 * 5e-3**2 / 3e-5)  # F = i^2 |dL/dd| / 2 against a preload of 0.1 N
    # It starts when the net force is 1e-9 of the largest one, 50 N
    assert start.current_A == pytest.approx(current, rel=1e-5)
    assert start.time_s == pytest.approx(-inductance(4e-3) / 20.0 * np.log(1.0 - 20.0 * current / 12.0), rel=1e-5)
    assert np.all(motion.table["distance_m"][motion.table["time_s"] < start.time_s] == 4e-3)


@pytest.mark.parametrize("effect", ["", "viscous_friction", "eddy_current_lag", "coil_temperature"])
def test_without_events_the_motion_is_that_of_the_fixed_step_plant(levitation_model, effect):
    model = usually(with_circuit(levitation_model, voltage_min_V=-3.0), *effect.split(), share=0.2)
    motion = simulate(model, voltage_V=2.0, start_m=0.022, duration_s=0.02, outside="extrapolate")
    state = np.array([[0.022, 0.0, 0.0, *np.zeros(len(model.memory_names))]])
    for _ in range(200):
        state = runge_kutta_step(model, state, np.full(1, 2.0), 1e-4)
    last = [motion.table[name][-1] for name in ("distance_m", "velocity_m_s", "current_A")]
    np.testing.assert_allclose(last, state[0, :3], rtol=1e-6)


def test_effects_act_on_mechanics_that_are_given_and_a_coil_that_is_not_known_is_left_out():
    drawn = searched()
    heavier = with_effects(drawn, [added("mass_error", mass_error=0.5), added("stop_position", far=0.01)])
    given = {"voltage_V": 3.0, "duration_s": 3e-3, "start_m": 3e-3}
    plain, same, other = (
        simulate(model, mechanics=mechanics, **given).table
        for model, mechanics in ((drawn, None), (heavier, None), (heavier, drawn.motion))
    )
    np.testing.assert_array_equal(same["distance_m"], other["distance_m"])
    assert plain["distance_m"][-1] > same["distance_m"][-1] > 3e-3
    assert "pickup_V" in plain
    iron = [added("core_saturation", mmf_loss_3=0.1)]
    for model in (with_eddies(drawn), with_effects(drawn, iron)):
        motion = simulate(model, **given)
        assert "pickup_V" not in motion.table
        assert "search" in motion.notes[-1]


def stepping(model, step, volts):
    """States of a body that rests on its far stop under voltages, sample by sample."""
    states, n = [np.eye(1, model.order) * model.motion.far_stop.distance_m], len(model.circuits)
    for each in volts[:-1]:
        states.append(step(states[-1], np.full((1, n) if n > 1 else 1, each / n)))
    return np.concatenate(states)


@pytest.mark.parametrize(
    ("kind", "restitution"), [("rigid", 0.0), ("rigid", 0.2), ("with eddy currents", 0.2), ("in halves", 0.0)]
)
def test_plant_and_filters_stay_on_a_stop_with_the_current_of_a_motion_with_events(kind, restitution):
    stops = {"near_stop": Stop(0.2e-3, restitution), "far_stop": Stop(4e-3, restitution)}
    whole = replace(with_motion(solenoid(), **stops), sample_time_s=2e-4)
    model = {"rigid": whole, "with eddy currents": with_eddies(whole, (2e-3,)), "in halves": cut_in_two(whole)}[kind]
    time = np.arange(800) * 2e-4
    volts = np.where(time < 0.11, 12.0, 0.0)
    alone = model if len(model.circuits) == 1 else whole
    found = simulate(alone, drive=pulse("voltage", 12.0, end=0.11), duration_s=time[-1], sample_time_s=2e-4).table
    distance, current = (np.interp(time, found["time_s"], found[name]) for name in ("distance_m", "current_A"))
    process = kalman_filter(replace(model, other_sensors=(LASER,)), sensors=("laser",)).process
    for step in (Plant(model).step, process.transition):
        states = stepping(replace(model, other_sensors=(LASER,)), step, volts)
        assert np.abs(states[:, 0] - distance).max() < 0.02 * 3.8e-3
        resting = (np.abs(distance - 0.2e-3) < 1e-9) & (time > 0.03)
        assert resting.sum() > 60
        assert np.abs(states[resting, 0] - 0.2e-3).max() < 1e-9
        assert np.abs(states[:, 2] - current)[resting].max() < 0.01 * current.max()
        assert np.abs(states[:, 2] - current).max() < 0.05 * current.max()


def test_a_start_that_rounding_keeps_from_the_stop_is_on_it():
    given = simulate(solenoid(), voltage_V=12.0, start_m=4e-3 * (1.0 - 1e-15))
    assert given.switchings == simulate(solenoid(), voltage_V=12.0).switchings


def test_a_body_pressed_on_a_stop_that_gives_way_comes_to_rest_in_it():
    stops = {"near_stop": Stop(0.2e-3, 0.2), "far_stop": Stop(4e-3, 0.2, 1e6)}
    model = solenoid(Mechanics(0.025, 0.0, springs=(Spring(0.0, 5.0),), **stops))
    motion = simulate(model, voltage_V=0.0, duration_s=0.02)
    assert not motion.switchings
    assert motion.table["distance_m"][-1] == pytest.approx(4e-3 + 5.0 / 1e6, abs=1e-9)


TIMES = (8e-3, 1e-5)


def closes(motion):
    return abs(motion.energy.remainder_J) < 1e-6 * motion.energy.supplied_J


def test_a_solid_solenoid_switches_later_and_the_energy_is_all_there():
    """Patterns of 10 us and 8 ms in one run."""
    plain, solid = solenoid(), with_eddies(solenoid(), TIMES)
    fast, slow = (simulate(model, drive=pulse("voltage", 12.0, end=0.16), duration_s=0.25) for model in (plain, solid))
    assert [one.kind for one in slow.switchings] == ["pull_in", "drop_out"]
    for before, after in zip(fast.switchings, slow.switchings, strict=True):
        assert after.switching_time_s > before.switching_time_s
    assert closes(slow)
    heat = sum(slow.table[name] ** 2 for name in ("eddy_1_A", "eddy_2_A"))  # of 1 ohm each
    assert np.trapezoid(heat, slow.table["time_s"]) == pytest.approx(slow.energy.eddy_J, rel=2e-2)
    assert slow.energy.eddy_J > 0.001 * slow.energy.supplied_J
    assert fast.energy.eddy_J == 0.0
    assert ("eddy" in str(fast), "eddy currents" in str(slow)) == (False, True)


def test_a_blocked_winding_leaves_its_core_the_eddy_currents():
    """Once the diode blocks, the current is zero and the force decays with the slowest pattern."""
    model = with_eddies(solenoid(HELD, Drive(diode_V=0.7)), (20e-3, 2e-3))
    motion = simulate(model, drive=pulse("voltage", 12.0), duration_s=0.08, start_m=4e-3)
    (stop,) = [event.time_s for event in motion.events if event.name == "current_stops"]
    table = motion.table
    after = table["time_s"] > stop + 0.01
    assert not table["current_A"][after].any()
    assert closes(motion)
    # Time constants of the two patterns beside an open winding, the eigenvalues of L_ee / R_e
    there = model.windings.magnetics.state(np.array(4e-3), np.zeros(3)).inductance[1:, 1:]
    slowest = np.linalg.eigvalsh(there).max()
    linked = table["flux_linkage_Wb"][after]
    rate = np.polyfit(table["time_s"][after][-50:], np.log(np.abs(linked[-50:])), 1)[0]
    assert -1.0 / rate == pytest.approx(slowest, rel=1e-2)


@pytest.mark.parametrize("bandwidth", [None, 2000.0])
def test_eddy_currents_behind_an_amplifier_answer_its_current_and_its_supply_limits_it(bandwidth):
    """A e' = -e - L_ei i' has e = -(1 - exp(-t / A)) L_ei i' along a ramp; at too low a supply the ramp is late."""
    model = with_eddies(solenoid(HELD, Drive("current", bandwidth_Hz=bandwidth)), (20e-3, 2e-3))
    command = Profile("current", np.array([0.0, 0.02]), np.array([0.0, 0.5]), "linear")
    supplied = [with_circuit(model, voltage_max_V=v) for v in (500.0, 2.0)]
    free, limited = (simulate(m, drive=command, duration_s=0.02, start_m=4e-3, sample_time_s=1e-5) for m in supplied)
    time, found = free.table["time_s"], free.table["flux_linkage_Wb"]
    there = model.windings.magnetics.state(np.array(4e-3), np.zeros(3)).inductance
    times, modes = np.linalg.eigh(there[1:, 1:])
    along = (modes.T @ there[1:, 0])[:, None] * 25.0 * (1.0 - np.exp(-time / times[:, None]))
    flux = there[0, 0] * 25.0 * time - there[0, 1:] @ modes @ along
    behind = 0.0 if bandwidth is None else there[0, 0] * 25.0 / (2.0 * np.pi * bandwidth)
    late = time > 0.01
    np.testing.assert_allclose((found - found[0])[late], flux[late] - behind, atol=2e-3 * flux.max())
    assert closes(free)
    assert limited.table["voltage_V"].max() <= 2.0
    assert limited.table["current_A"][-1] < 0.9 * free.table["current_A"][-1]


def test_the_energy_of_two_circuits_and_of_a_fall_past_a_ring_is_all_there(levitation_model):
    stopped = with_motion(levitation_model, far_stop=Stop(0.04), near_stop=Stop(0.016))
    model = with_eddies(cut_in_two(stopped), TIMES)
    fed = simulate(model, voltage_V={"inner": 1.0, "outer": 0.0}, duration_s=0.05, start_m=0.04)
    model = with_eddies(magnets_alone(with_motion(levitation_model, far_stop=Stop(0.044))), (5e-3, 1e-4))
    falling = simulate(model, duration_s=0.06, start_m=0.036, outside="extrapolate")
    for motion in (fed, falling):
        assert closes(motion)
        assert motion.energy.eddy_J > 0.0
    assert falling.energy.source_J == 0.0
