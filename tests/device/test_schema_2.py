"""Actuator files of schema 2: several coils, moving coils, circuits, mechanics and sensors of every kind."""

import json
import math
from dataclasses import asdict

import numpy as np
import pytest

from femfit.core.atomic import json_ready
from femfit.core.errors import ActuatorFileError
from femfit.device.load import actuator_from_toml
from femfit.device.mechanics import ForceTable, Spring, Stop
from femfit.device.read_electrics import check_circuit_names
from femfit.device.sensors import CurrentSensor, HallElement, PickupCoil, PositionSensor
from femfit.device.summary import actuator_from_record, sweep_manifest_entry
from femfit.model.impedance import impedances_by_column

VOICE_COIL = """
schema = 2
name = "voice-coil"

[fixed.regions.yoke]
material = "low_carbon_steel"
polygon_mm = [[0, -20], [30, -20], [30, 0], [16, 0], [16, -4], [26, -4], [26, -16], [0, -16]]

[fixed.regions.magnet]
material = "n42"
magnetization = "+z"
r_mm = [0, 12]
z_mm = [-16, -4]

[fixed.regions.pole]
material = "low_carbon_steel"
polygon_mm = [[0, -4], [12, -4], [12, 0, 90], [0, 0]]

[coils.voice]
r_mm = [13, 14.5]
z_mm = [0, 8]
turns = 100
resistance_ohm = 4.7
moves = true

[circuits.amplifier]
coils = ["-voice"]
external_resistance_ohm = 0.1
drive = "current"
current_min_A = -2
current_max_A = 2

[mechanics]
mass_g = 12
gravity = "horizontal"
coulomb_N = 0.02
travel_mm = [-4, 2]

[mechanics.springs.spider]
stiffness_N_per_mm = 1.5

[mechanics.springs.measured]
distance_mm = [-4, 0, 2]
force_N = [2, 0, -1]

[sensors.i]
kind = "current"
noise_A = 0.01

[sensors.laser]
kind = "position"
gain_V_per_mm = 1
range_V = [-5, 5]
bits = 12

[sensors.gap]
kind = "hall"
r_mm = 15.2
z_mm = 1
direction = "r"

[sensors.pickup]
kind = "pickup_coil"
circle_mm = [40, 0, 1]
turns = 50

[sweep]
current_A = [-1, 0, 1]
distance_mm = { start = -4, stop = 2, step = 1 }
"""

PAIR = """
schema = 2
name = "magnet-pair"

[fixed.regions.ring]
material = "n42"
magnetization = "+r"
r_mm = [6, 10]
z_mm = [-5, 0]

[moving.regions.ball]
material = "n42"
magnetization = [1, 1]
circle_mm = [0, 4, 4]

[mechanics]
mass_g = 10
gravity_deg = 60

[sweep]
distance_mm = [1, 2, 3]
"""

BEARING = """
schema = 2
name = "bearing"

[coils.upper]
r_mm = [19, 31]
z_mm = [18, 25]
turns = 150
wire_diameter_mm = 0.6

[coils.lower]
r_mm = [19, 31]
z_mm = [-8, -1]
turns = 150
wire_diameter_mm = 0.6

[moving]
mass_g = 500

[moving.regions.disk]
material = "low_carbon_steel"
r_mm = [9, 41]
z_mm = [0, 10]

[supply]
voltage_min_V = 0
voltage_max_V = 24
diode_V = 0.7

[sweep]
current_A = { upper = { start = 0, stop = 2, step = 1 }, lower = [0, 2] }
distance_mm = [0.5, 1]
"""


def problems_of(text: str) -> tuple[str, ...]:
    with pytest.raises(ActuatorFileError) as caught:
        actuator_from_toml(text, "test.toml")
    return caught.value.problems


def test_a_voice_coil_is_read_in_si_units():
    actuator = actuator_from_toml(VOICE_COIL)
    (coil,), (circuit,) = actuator.coils, actuator.circuits
    assert (coil.name, coil.moves, coil.turns) == ("voice", True, 100)
    assert (coil.circuit, coil.sign) == (circuit.name, -1.0)
    assert circuit.resistance_ohm == pytest.approx(4.8)
    assert (circuit.drive.kind, circuit.drive.current_min_A, circuit.drive.current_max_A) == ("current", -2, 2)
    mechanics = actuator.mechanics
    assert (mechanics.mass_kg, mechanics.gravity_m_s2, mechanics.coulomb_N) == (0.012, 0.0, 0.02)
    assert mechanics.springs == (Spring(1500.0), ForceTable((-0.004, 0.0, 0.002), (2.0, 0.0, -1.0)))
    assert (mechanics.near_stop, mechanics.far_stop) == (Stop(-0.004), Stop(0.002))
    current, laser, hall, pickup = actuator.sensors
    assert isinstance(current, CurrentSensor)
    assert (current.circuit, current.noise) == ("amplifier", 0.01)
    assert isinstance(laser, PositionSensor)
    assert (laser.readings, laser.minimum, laser.maximum, laser.bits) == ((0.0, 1000.0), -5, 5, 12)
    assert isinstance(hall, HallElement)
    assert (hall.direction, hall.name) == ((1.0, 0.0), "gap")
    assert isinstance(pickup, PickupCoil)
    assert actuator.sweep.distances_m[0] == -0.004
    assert actuator.fixed[2].bulges == pytest.approx((0.0, 0.0, math.tan(math.pi / 8), 0.0))


def test_a_pair_of_magnets_needs_no_coil():
    actuator = actuator_from_toml(PAIR)
    assert actuator.coils == actuator.circuits == ()
    assert actuator.sweep.currents_A == (0.0,)
    ring, ball = actuator.fixed[0].material, actuator.moving.regions[0].material
    assert ring.direction == (1.0, 0.0)
    assert ball.direction == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))
    assert actuator.mechanics.gravity_m_s2 == pytest.approx(0.5 * 9.80665)


def test_two_coils_have_a_circuit_and_currents_each():
    actuator = actuator_from_toml(BEARING)
    assert [circuit.name for circuit in actuator.circuits] == ["upper", "lower"]
    assert actuator.circuits[0].drive.diode_V == 0.7
    assert (actuator.sweep.currents_A, actuator.sweep.further_A) == ((0.0, 1.0, 2.0), ((0.0, 2.0),))


@pytest.mark.parametrize("text", [VOICE_COIL, PAIR, BEARING])
def test_a_record_rebuilds_the_actuator_and_the_manifest_is_json(text):
    actuator = actuator_from_toml(text)
    record = json.loads(json.dumps(json_ready(asdict(actuator)), allow_nan=False))
    assert actuator_from_record(record, "record") == actuator
    json.dumps(sweep_manifest_entry(actuator), allow_nan=False)


def test_records_of_earlier_versions_have_the_coils_in_their_circuit_and_the_limits_in_its_drive():
    actuator = actuator_from_toml(VOICE_COIL)
    record = json_ready(asdict(actuator))
    (circuit,), (coil,) = record["circuits"], record["coils"]
    kept = {key: circuit[key] for key in ("name", "resistance_ohm", "inductance_H")}
    drive = {"kind": "current", "minimum": -2.0, "maximum": 2.0, "diode_V": None}
    drive["bandwidth_Hz"] = circuit["drive"]["bandwidth_Hz"]
    early = {**kept, "coils": [[coil["name"], coil.pop("sign")]], "drive": drive}
    assert coil.pop("circuit") == circuit["name"]
    assert actuator_from_record(record | {"circuits": [early]}, "record") == actuator
    supply = {"voltage_min_V": -12.0, "voltage_max_V": 12.0, "sample_time_s": 1e-4}
    fed = actuator_from_record(record | {"circuits": [early], "supply": supply}, "record")
    assert (fed.sample_time_s, fed.supplies_V) == (1e-4, ((-12.0, 12.0),))


def test_the_voltages_behind_an_amplifier_are_its_circuits_or_else_the_supplys():
    (open_ended,) = actuator_from_toml(VOICE_COIL).circuits
    assert (open_ended.voltage_min_V, open_ended.voltage_max_V) == (-math.inf, math.inf)
    supply = "[supply]\nvoltage_min_V = -12\nvoltage_max_V = 12\n"
    (fed,) = actuator_from_toml(VOICE_COIL + supply).circuits
    assert (fed.voltage_min_V, fed.voltage_max_V) == (-12.0, 12.0)
    limits = 'drive = "current"\nvoltage_min_V = -48\nvoltage_max_V = 48\n'
    own = actuator_from_toml(VOICE_COIL.replace('drive = "current"\n', limits) + supply)
    assert (own.circuits[0].voltage_min_V, own.circuits[0].voltage_max_V) == (-48.0, 48.0)
    assert sweep_manifest_entry(own)["voltage_max_V"] == 48.0


def named(*circuits):
    """What a drawing with circuits of these names is told."""
    problems = []
    check_circuit_names(circuits, problems)
    return problems


@pytest.mark.parametrize(
    ("names", "column"),
    [
        (("a", "b", "a_b"), "inductance_a_b_H"),
        (("b_a", "a", "b"), "inductance_b_a_H"),
        (("a", "b", "b_shorted"), "inductance_a_b_shorted_H"),
        (("a", "b", "a_b_shorted"), "inductance_a_b_shorted_H"),
        (("a", "b_c", "a_b", "c"), "inductance_a_b_c_H"),
    ],
)
def test_circuits_of_which_two_impedances_had_one_column_are_refused(names, column):
    (said,) = named(*names)
    assert column in said
    assert "Rename" in said


def test_names_that_keep_all_impedances_apart_are_taken():
    for names in ((), ("a",), ("coil_1", "coil_2", "coil_3"), ("a", "a_b"), ("a", "a_shorted"), ("upper", "lower")):
        assert named(*names) == []
        readings = impedances_by_column(np.eye(len(names)), names) if len(names) > 1 else {}
        assert len(readings) == len(names) * (2 * len(names) - 1) * bool(readings)


MISTAKES = {
    "circuits of which two inductances had one column": (
        BEARING,
        (
            "[supply]",
            "[coils.lower_upper]\nr_mm = [40, 41]\nz_mm = [-80, -79]\nturns = 10\nresistance_ohm = 1\n[supply]",
        ),
        ["inductance_lower_upper_H"],
    ),
    "spring given twice over": (
        VOICE_COIL,
        ("stiffness_N_per_mm = 1.5", "stiffness_N_per_mm = 1.5\nforce_N = [1, 2]"),
        ["springs.spider must have either"],
    ),
    "preload without its place": (
        VOICE_COIL,
        ("stiffness_N_per_mm = 1.5", "stiffness_N_per_mm = 1.5\npreload_N = 2"),
        ["preload_at_mm is missing"],
    ),
    "stops that keep the body from the sweep": (
        VOICE_COIL,
        ("travel_mm = [-4, 2]", "travel_mm = [3, 5]"),
        ["near_stop must leave distances of the sweep, -4 to 2 mm"],
    ),
    "circuit of an unknown coil": (VOICE_COIL, ('["-voice"]', '["-voise"]'), ["Did you mean 'voice'?"]),
    "sensor of an unknown kind": (VOICE_COIL, ('kind = "hall"', 'kind = "holl"'), ["Did you mean 'hall'?"]),
    "converter without a range": (VOICE_COIL, ("range_V = [-5, 5]\n", ""), ["range_V is missing"]),
    "amplifier without limits": (VOICE_COIL, ("current_min_A = -2\n", ""), ["current_min_A and current_max_A"]),
    "coil in the way": (VOICE_COIL, ("r_mm = [13, 14.5]", "r_mm = [11.5, 14.5]"), ["coils.voice collides"]),
    "coil in no circuit": (
        BEARING,
        ("[supply]", '[circuits.one]\ncoils = ["upper"]\n[supply]'),
        ["lower is in none"],
    ),
    "currents of one circuit for two": (
        BEARING,
        ("{ upper = { start = 0, stop = 2, step = 1 }, lower = [0, 2] }", "[0, 1]"),
        ["each circuit", "upper, lower"],
    ),
    "diode beside a bridge": (BEARING, ("voltage_min_V = 0", "voltage_min_V = -24"), ["diode_V must be left out"]),
    "no driver": (
        BEARING,
        ("[supply]\nvoltage_min_V = 0\nvoltage_max_V = 24\ndiode_V = 0.7\n", ""),
        ["supply is missing"],
    ),
    "nothing that stands still": (
        PAIR,
        ('[fixed.regions.ring]\nmaterial = "n42"\nmagnetization = "+r"\nr_mm = [6, 10]\nz_mm = [-5, 0]\n', ""),
        ["fixed.regions must hold a part"],
    ),
    "direction of no length": (PAIR, ("[1, 1]", "[0, 0]"), ["magnetization must have a direction"]),
    "ball beside the axis": (PAIR, ("[0, 4, 4]", "[1, 4, 4]"), ["centre on the axis"]),
    "schema 1 with tables of schema 2": (PAIR, ("schema = 2", "schema = 1"), ["needs schema = 2"]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_says_where_and_what_to_do(mistake):
    text, (old, new), fragments = MISTAKES[mistake]
    assert text.count(old) == 1
    changed = text.replace(old, new)
    first, *_ = problems_of(changed)
    for fragment in fragments:
        assert fragment in first
