"""Several circuits in open loop, and none: halves of a coil are the coil, and every joule is accounted for."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import TableError, UsageError
from femfit.device.electrics import Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.fit.build import fit_model
from femfit.report.motion_figures import open_loop_figure
from femfit.simulation.open_loop import simulate
from femfit.simulation.profile import Profile, read_profiles
from support.bearing import table_of
from support.halves import NAMES, cut_in_two
from support.solenoids import solenoid

PULSE = np.array([0.0, 0.08])
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
    whole = solenoid(drive=drive)
    whole = replace(whole, circuits=(replace(whole.circuit, inductance_H=2e-3),))
    share = 0.5 if kind == "voltage" else 1.0
    one = simulate(whole, drive=Profile(kind, PULSE, np.array([on, 0.0])), duration_s=0.15)
    command = Profile(kind, PULSE, share * np.array([on, 0.0]))
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
    assert abs(two.energy.remainder_J) < 1e-6 * two.energy.supplied_J
    assert abs(one.energy.remainder_J) < 1e-6 * one.energy.supplied_J


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
    drive = {
        "lower": Profile("voltage", np.array([0.0, 0.01]), np.array([1.5, -1.5])),
        "upper": Profile("voltage", np.array([0.0, 0.02]), np.array([1.2, 0.0])),
    }
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
    held = Mechanics(0.025, 0.0, springs=(Spring(0.0, 50.0),), near_stop=Stop(0.2e-3), far_stop=Stop(4e-3))
    model = cut_in_two(solenoid(held, Drive(diode_V=0.2)))
    off = Profile("voltage", np.array([0.0, 0.02]), np.array([6.0, 0.0]))
    motion = simulate(model, drive={"inner": off}, duration_s=0.05)
    outer, time = motion.table["current_outer_A"], motion.table["time_s"]
    assert np.all(outer[time < 0.0199] == 0.0)  # a rising current drives it against its diode
    assert outer.max() > 0.05  # a falling one through it
    names = {(event.name, event.circuit) for event in motion.events}
    assert {("current_stops", "outer"), ("current_stops", "inner")} <= names
    assert abs(motion.energy.remainder_J) < 1e-6 * motion.energy.supplied_J


def test_an_amplifier_feels_what_the_other_circuit_induces(bearing):
    """One current is held while the other's voltage steps; the voltage that holds it follows the mutual inductance."""
    amplifier = replace(bearing.circuits[1], drive=Drive("current"), voltage_min_V=-24.0)
    held = Mechanics(1e6, 0.0)
    model = replace(bearing, circuits=(bearing.circuits[0], amplifier), motion=held)
    motion = simulate(model, voltage_V={"lower": 3.0}, current_A={"upper": 0.0}, duration_s=0.002, start_m=0.5e-3)
    inductance = model.inductance(0.5e-3, [0.0, 0.0])
    rate = 3.0 / inductance[0, 0]  # of the first moment
    assert motion.table["voltage_upper_V"][0] == pytest.approx(inductance[0, 1] * rate, rel=1e-6)
    np.testing.assert_allclose(motion.table["current_upper_A"], 0.0, atol=1e-12)


def test_a_command_and_the_end_of_the_domain_name_their_circuits(bearing):
    with pytest.raises(UsageError, match="lower, upper"):
        simulate(bearing, voltage_V=2.0)
    with pytest.raises(UsageError, match="sideways"):
        simulate(bearing, voltage_V={"sideways": 2.0})
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
