"""What feeds the winding in open loop: bridge, freewheel diode, current amplifier; and where the energy goes."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError, TableError, UsageError
from femfit.device.electrics import Drive
from femfit.device.mechanics import Stop
from femfit.model.validity import ValidityBox
from femfit.simulation.open_loop import simulate
from femfit.simulation.profile import Profile, read_profiles
from support.one_current import flat
from support.parts import with_circuit, with_motion
from support.solenoids import HELD, NoField, solenoid
from support.switching import pulse

DENSE_A = 1e-8
"""Between the integrator's steps its interpolation is a little worse than 1e-9 of the range, 4 A."""


def coil(drive=None, series_H=0.0):
    """A winding of 10 mH and 20 ohm beside a body that rests."""
    return with_circuit(replace(solenoid(HELD, drive), magnetics=NoField()), inductance_H=series_H)


@pytest.mark.parametrize("series_H", [0.0, 0.03])
def test_a_step_of_voltage_charges_the_winding_and_what_is_in_series_with_l_over_r(series_H):
    motion = simulate(coil(series_H=series_H), voltage_V=10.0, duration_s=0.005)
    found, inductance = motion.table, 0.01 + series_H
    rising = 1.0 - np.exp(-20.0 / inductance * found["time_s"])
    np.testing.assert_allclose(found["current_A"], 0.5 * rising, atol=DENSE_A)
    np.testing.assert_allclose(found["voltage_V"], 10.0)
    assert motion.energy.magnetic_J == pytest.approx(0.5 * inductance * found["current_A"][-1] ** 2, rel=1e-6)


def test_a_ramp_of_voltage_is_followed_and_cut_at_the_supply():
    ramp = Profile("voltage", np.array([0.0, 0.01]), np.array([0.0, 24.0]), "linear")
    motion = simulate(coil(), drive=ramp)
    time, tau = motion.table["time_s"], 5e-4
    before = time < 5e-3
    climbing = 2400.0 / 20.0 * (time - tau * (1.0 - np.exp(-time / tau)))
    np.testing.assert_allclose(motion.table["current_A"][before], climbing[before], atol=DENSE_A)
    assert motion.table["voltage_V"].max() == 12.0
    assert "cut" in str(motion)


@pytest.mark.parametrize("drop", [0.7, 24.7])
def test_the_current_goes_on_through_the_diode_until_it_is_zero(drop):
    motion = simulate(coil(Drive(diode_V=drop)), drive=pulse("voltage", 12.0, end=0.01), duration_s=0.02)
    current = 0.6 * (1.0 - np.exp(-20.0))
    over = 0.01 + 5e-4 * np.log(1.0 + 20.0 * current / drop)
    assert [event.time_s for event in motion.events] == [pytest.approx(over, rel=1e-8)]
    time, found = motion.table["time_s"], motion.table["current_A"]
    freewheeling = (time > 0.01) & (time < over)
    decay = (current + drop / 20.0) * np.exp(-2000.0 * (time - 0.01)) - drop / 20.0
    np.testing.assert_allclose(found[freewheeling], decay[freewheeling], atol=DENSE_A)
    np.testing.assert_allclose(motion.table["voltage_V"][freewheeling], -drop)
    assert np.all(found[time > over] == 0.0)
    burnt = drop * 5e-4 * (current - drop / 20.0 * (over - 0.01) / 5e-4)
    assert motion.energy.diode_J == pytest.approx(burnt, rel=1e-6)


def test_a_magnet_that_falls_away_drives_a_current_through_the_diode(levitation_model):
    drop = 5e-3
    model = with_circuit(levitation_model, voltage_min_V=0.0, drive=Drive(diode_V=drop))
    motion = simulate(model, voltage_V=0.0, start_m=0.02, duration_s=0.06)
    flows = next(event for event in motion.events if event.name == "current_flows")
    constant = float(flat(levitation_model.magnetics).motional_constant(np.array([flows.distance_m]), np.zeros(1))[0])
    assert constant * flows.velocity_m_s == pytest.approx(drop, rel=1e-6)
    assert motion.table["current_A"].min() == 0.0
    assert motion.table["current_A"].max() > 1e-4


def test_a_current_amplifier_ramps_at_its_voltage_and_then_follows():
    motion = simulate(coil(Drive("current")), drive=pulse("current", 0.3, 0.1, 0.01), duration_s=0.02)
    time, found = motion.table["time_s"], motion.table["current_A"]
    reached = -5e-4 * np.log(1.0 - 0.3 * 20.0 / 12.0)
    np.testing.assert_allclose(found[(time > reached) & (time < 0.01)], 0.3, rtol=1e-12)
    ramp = time < reached
    np.testing.assert_allclose(found[ramp], 0.6 * (1.0 - np.exp(-2000.0 * time[ramp])), atol=DENSE_A)
    assert found[-1] == 0.1
    assert motion.table["voltage_V"][-1] == pytest.approx(2.0)


def test_a_current_amplifier_approaches_with_its_bandwidth_and_keeps_to_its_limits():
    motion = simulate(coil(Drive("current", bandwidth_Hz=50.0)), current_A=0.2, duration_s=0.01)
    expected = 0.2 * (1.0 - np.exp(-100.0 * np.pi * motion.table["time_s"]))
    np.testing.assert_allclose(motion.table["current_A"], expected, atol=DENSE_A)
    motion = simulate(coil(Drive("current", None, 0.0, 0.25)), current_A=0.5, duration_s=0.01)
    assert motion.table["current_A"].max() == pytest.approx(0.25)
    assert motion.notes
    with pytest.raises(DomainError, match="--current"):
        simulate(coil(Drive("current")), voltage_V=3.0)


@pytest.mark.parametrize(
    ("drive", "kind", "on"),
    [(Drive(diode_V=0.7), "voltage", 12.0), (Drive("current", bandwidth_Hz=300.0), "current", 0.595)],
    ids=["diode", "amplifier of a bandwidth"],
)
def test_all_energy_is_accounted_for_with_friction_and_a_stop_that_gives_way(drive, kind, on):
    """Rigid stops and other drivers: two halves switch as the whole coil."""
    stops = {"near_stop": Stop(0.2e-3, 0.4), "far_stop": Stop(4e-3, 0.2, 1e6)}
    rough = with_motion(solenoid(drive=drive), gravity_m_s2=-2.0, viscous_N_s_per_m=0.3, coulomb_N=0.02, **stops)
    motion = simulate(with_motion(rough, load_N=0.01), drive=pulse(kind, on, end=0.08), duration_s=0.15)
    assert [one.kind for one in motion.switchings][:2] == ["pull_in", "drop_out"]
    assert abs(motion.energy.remainder_J) < 1e-6 * motion.energy.supplied_J
    assert motion.energy.impact_J > 0.0
    assert motion.energy.friction_J > 0.0
    # Copper by the table alone, to the trapezoids' error
    i, t = motion.table["current_A"], motion.table["time_s"]
    assert motion.energy.copper_J == pytest.approx(20.0 * np.trapezoid(i**2, t), rel=1e-3)


def test_leaving_the_domain_is_said_and_ends_the_simulation():
    model = replace(solenoid(), validity=ValidityBox.of_currents((0.1e-3, 6e-3), (-0.3, 0.3)))
    motion = simulate(model, voltage_V=12.0)
    ((name, time),) = motion.left_domain
    assert name == "current"
    assert motion.end_s == time < 0.01
    assert motion.table["time_s"][-1] <= time
    assert motion.table["current_A"].max() < 0.3 * (1.0 + 1e-5)
    beyond = simulate(model, voltage_V=12.0, outside="extrapolate")
    assert beyond.extrapolated
    assert beyond.left_domain == (("current", pytest.approx(time, rel=1e-9)),)
    assert beyond.end_s == 0.1
    assert beyond.table["current_A"].max() > 0.3
    assert "extrapolated" in str(beyond).splitlines()[1]  # after what came of the motion


@pytest.mark.parametrize(
    ("error", "given"),
    [(DomainError, {"start_m": 0.02}), (DomainError, {"start_m": 5e-3}), (UsageError, {"current_A": 1.0})],
    ids=["beyond the model", "beyond its stop", "two commands"],
)
def test_a_start_outside_of_domain_or_stops_and_two_commands_are_refused(error, given):
    with pytest.raises(error):
        simulate(solenoid(), voltage_V=12.0, **given)


def test_a_profile_is_read_held_or_interpolated(tmp_path):
    path = tmp_path / "drive.csv"
    path.write_text("time_ms;voltage_V\n0;0\n10;12\n20;4\n")
    for interpolation, wanted in (("held", [0.0, 0.0, 12.0, 12.0, 4.0]), ("linear", [0.0, 6.0, 12.0, 8.0, 4.0])):
        linear = read_profiles(path, interpolation=interpolation)["coil"]
        assert [linear.at(t) for t in (-1.0, 0.005, 0.01, 0.015, 1.0)] == pytest.approx(wanted)
    cut = linear.within(0.0, 6.0)
    np.testing.assert_allclose(cut.time_s, [0.0, 0.005, 0.01, 0.0175, 0.02])
    np.testing.assert_allclose(cut.value, [0.0, 6.0, 6.0, 6.0, 4.0])
    assert simulate(coil(), drive=path).duration_s == 0.02


@pytest.mark.parametrize("columns", ["time_s,distance_m", "voltage_V,force_N", "time_s,voltage_V,current_A"])
def test_a_profile_without_a_time_or_with_two_commands_is_refused(tmp_path, columns):
    path = tmp_path / "drive.csv"
    path.write_text(f"{columns}\n" + "\n".join(",".join([str(k)] * len(columns.split(","))) for k in range(3)))
    with pytest.raises(TableError, match="time_s"):
        read_profiles(path)
