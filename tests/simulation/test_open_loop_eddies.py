"""Eddy currents in open loop: switching, a diode that blocks, a current amplifier, a fall past a ring."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.simulation.open_loop import simulate
from femfit.simulation.plant import Plant
from femfit.simulation.profile import Profile
from support.added_effects import under_effects
from support.eddies import magnets_alone, with_eddies
from support.halves import cut_in_two
from support.solenoids import solenoid

TIMES = (8e-3, 1e-5)
HELD = Mechanics(0.025, 0.0, springs=(Spring(0.0, 5.0),), near_stop=Stop(0.2e-3), far_stop=Stop(4e-3))
"""Pressed on its far stop."""


def closes(motion):
    return abs(motion.energy.remainder_J) < 1e-6 * motion.energy.supplied_J


def test_a_solid_solenoid_switches_later_and_the_energy_is_all_there():
    """Patterns of 10 us and 8 ms in one run."""
    plain, solid = solenoid(), with_eddies(solenoid(), TIMES)
    command = Profile("voltage", np.array([0.0, 0.16]), np.array([12.0, 0.0]))
    fast, slow = (simulate(model, drive=command, duration_s=0.25) for model in (plain, solid))
    assert [one.kind for one in slow.switchings] == ["pull_in", "drop_out"]
    for before, after in zip(fast.switchings, slow.switchings, strict=True):
        assert after.switching_time_s > before.switching_time_s
    assert closes(slow)
    heat = sum(slow.table[name] ** 2 for name in ("eddy_1_A", "eddy_2_A"))  # of 1 ohm each
    assert np.trapezoid(heat, slow.table["time_s"]) == pytest.approx(slow.energy.eddy_J, rel=2e-2)
    assert slow.energy.eddy_J > 0.001 * slow.energy.supplied_J
    assert fast.energy.eddy_J == 0.0
    assert "eddy currents" in str(slow)
    assert "eddy" not in str(fast)


def test_effects_beside_eddy_currents_leave_the_motion_where_they_do_nothing():
    model = with_eddies(solenoid(), TIMES)
    plain, under = (
        simulate(one, voltage_V=12.0, duration_s=0.015).table
        for one in (model, under_effects(model, ("supply_sag", {})))
    )
    for name in ("distance_m", "current_A", "force_N"):
        np.testing.assert_allclose(under[name], plain[name], atol=1e-3 * np.abs(plain[name]).max())  # the table's error


def test_a_blocked_winding_leaves_its_core_the_eddy_currents():
    """Once the diode blocks, the current is zero and the force decays with the slowest pattern."""
    model = with_eddies(solenoid(HELD, Drive(diode_V=0.7)), (20e-3, 2e-3))
    command = Profile("voltage", np.array([0.0, 0.02]), np.array([12.0, 0.0]))
    motion = simulate(model, drive=command, duration_s=0.08, start_m=4e-3)
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


def test_the_plant_follows_a_diode_as_the_open_loop_does():
    """The closed loop's steps keep the flux that the patterns link where a diode blocks."""
    model = with_eddies(solenoid(HELD, Drive(diode_V=0.7)), (20e-3, 2e-3))
    model = replace(model, sample_time_s=0.1e-3, motion=Mechanics(1e9, 0.0))
    command = Profile("voltage", np.array([0.0, 0.02]), np.array([12.0, 0.0]))
    table = simulate(model, drive=command, duration_s=0.04, start_m=4e-3, sample_time_s=0.1e-3).table
    plant = Plant(model)
    state, found = plant.start(np.array([[4e-3, 0.0, 0.0]])), []
    for k in range(400):
        found.append(float(model.windings.magnetics.force(state[:, 0], state[:, 2 : model.windings.end])[0]))
        state = plant.step(state, np.array([12.0 if k < 200 else 0.0]))
    wanted = table["force_N"][:400]
    np.testing.assert_allclose(found, wanted, atol=2e-3 * wanted.max())  # the diode blocks within a step


@pytest.mark.parametrize("bandwidth", [None, 2000.0])
def test_behind_an_amplifier_eddy_currents_answer_a_current_that_is_given(bandwidth):
    drive = Drive("current", bandwidth_Hz=bandwidth)
    model = with_eddies(solenoid(HELD, drive), (20e-3, 2e-3))
    model = replace(model, circuits=(replace(model.circuit, voltage_min_V=-500.0, voltage_max_V=500.0),))
    command = Profile("current", np.array([0.0, 0.02]), np.array([0.0, 0.5]), "linear")
    motion = simulate(model, drive=command, duration_s=0.02, start_m=4e-3, sample_time_s=1e-5)
    time, current = motion.table["time_s"], motion.table["current_A"]
    if bandwidth is None:
        np.testing.assert_allclose(current, 25.0 * time, atol=1e-6)
    there = model.windings.magnetics.state(np.array(4e-3), np.zeros(3)).inductance
    # A e' = -e - L_ei i' with e(0) = 0: e = -(1 - exp(-t / A)) L_ei i' of a ramp
    times, modes = np.linalg.eigh(there[1:, 1:])
    along = modes.T @ there[1:, 0] * 25.0
    patterns = -(modes @ (along[:, None] * (1.0 - np.exp(-time / times[:, None])))).T
    flux = there[0, 0] * 25.0 * time + patterns @ there[0, 1:]
    late = time > 0.01
    shift = 0.0 if bandwidth is None else there[0, 0] * 25.0 / (2.0 * np.pi * bandwidth)
    found = motion.table["flux_linkage_Wb"]
    constant = found[0]  # nothing moves: what the patterns' magnets link is constant
    np.testing.assert_allclose((found - constant)[late], flux[late] - shift, atol=2e-3 * flux.max())
    assert closes(motion)


def test_two_circuits_share_their_eddy_currents(levitation_model):
    stop = replace(levitation_model.motion, far_stop=Stop(0.04), near_stop=Stop(0.016))
    model = with_eddies(cut_in_two(replace(levitation_model, motion=stop)), TIMES)
    motion = simulate(model, voltage_V={"inner": 1.0, "outer": 0.0}, duration_s=0.05, start_m=0.04)
    assert closes(motion)
    assert motion.energy.eddy_J > 0.0


def test_a_magnet_falls_past_a_ring_and_its_energy_goes_to_heat(levitation_model):
    body = replace(levitation_model.motion, near_stop=None, far_stop=Stop(0.044))
    model = with_eddies(magnets_alone(replace(levitation_model, motion=body)), (5e-3, 1e-4))
    motion = simulate(model, duration_s=0.06, start_m=0.036, outside="extrapolate")
    assert closes(motion)
    assert motion.energy.eddy_J > 0.0
    assert motion.energy.source_J == 0.0
