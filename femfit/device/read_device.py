"""Windings, circuits, mechanics, sensors and the grid of an actuator file, from its right tables by their key paths."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from math import inf
from typing import Any

from femfit.device.complaints import Reading, complain, joined, read_entry, read_part, read_value, refuse_name, table_at
from femfit.device.drawing import DrawnPart, part_tables
from femfit.device.electrics import AnySensor, Circuit, CurrentSensor, Drive, PickupCoil
from femfit.device.keys import Entry, Outline, converted, keys_of
from femfit.device.mechanics import Mechanics
from femfit.device.outlines import flattened, outline
from femfit.device.parts import REFERENCE_TEMPERATURE, Coil, smallest_winding_area, wire_resistance
from femfit.device.schema import RangeEntry, SupplyEntry, SweepEntry

MIN_DISTANCE = 1e-3
"""In mm, of schema 1: a micrometre is less than a face is flat, and still a gap that can be meshed."""


def read_coils(file: Reading, parts: Sequence[DrawnPart]) -> Iterator[Coil]:
    """The windings whose tables are right, in the file's order."""
    for winding in (body for body in parts if body.winding and body.path in file.entries):
        entry: Entry = file.entries[winding.path]
        diameter, resistance = entry.wire_diameter_mm, entry.resistance_ohm
        temperature = REFERENCE_TEMPERATURE if diameter is None or resistance is not None else entry.temperature_C
        if diameter is not None:
            area, radius = winding.polygon.area, winding.polygon.centroid.x * 1e-3
            if (needed := smallest_winding_area(entry.turns, diameter)) > area:
                file.complain("wire", winding.path, turns=entry.turns, wire=diameter, needed=needed, area=area)
            if resistance is None:
                resistance = wire_resistance(entry.turns, radius, diameter * 1e-3, temperature)
        if resistance is None:
            file.complain("resistance", winding.path)
            continue
        # Its arcs become chords: nothing of it is singular at a corner
        outline, name = winding.outline, winding.place[-1]
        corners = converted(flattened(outline.corners, outline.bulges), -3)
        wire = converted(diameter, -3)
        yield Coil(corners, entry.turns, resistance, wire, name, winding.moves, name, temperature_C=temperature)


def read_circuits(file: Reading, parts: Sequence[DrawnPart]) -> tuple[tuple[Circuit, ...], tuple[Coil, ...]]:
    """The circuits in their order, without a table one a coil, and the coils as they are connected in them."""
    coils = {coil.name: coil for coil in read_coils(file, parts)}
    supply: SupplyEntry | None = file.entries.get("supply")
    usual = {key: getattr(supply, key, None) for key in ("voltage_min_V", "voltage_max_V", "diode_V")}
    _check_driver(file, "supply", *usual.values())
    tables = table_at(file.data, "circuits")
    if coils and not tables and "supply" not in file.data:
        file.complain("no_supply")
    connected: dict[str, Coil] = {}
    circuits, count = [], len(file.problems)
    for name in tables or coils:
        path = joined("circuits", name)
        entry = file.entries.get(path) if tables else read_entry(Circuit, {"coils": [name]}, path, [])
        if entry is None:
            continue
        members = list(_connected(file, entry.coils, name, coils, connected))
        resistance = sum(coil.resistance_ohm for coil in members) + entry.external_resistance_ohm
        low, high, diode_V = (usual[key] if getattr(entry, key) is None else getattr(entry, key) for key in usual)
        drive = Drive(diode_V=diode_V)
        if entry.drive == "current":
            drive = Drive("current", None, entry.current_min_A, entry.current_max_A, entry.bandwidth_Hz)
            if None in (drive.current_min_A, drive.current_max_A):
                file.complain("no_currents", path)
            _check_ascent(file, path, current_min_A=drive.current_min_A, current_max_A=drive.current_max_A)
        elif tables and None in (low, high) and (supply is not None or "supply" not in file.data):
            file.complain("no_voltages", path)
        if tables:
            _check_driver(file, path, low, high, entry.diode_V if entry.drive == "voltage" else None)
        low, high = (-inf, inf) if low is None or high is None else (low, high)
        circuits.append(Circuit(resistance, low, high, drive, name, converted(entry.external_inductance_mH, -3)))
    unconnected = ", ".join(coil for coil in coils if coil not in connected)
    if unconnected and len(file.problems) == count and len(circuits) == len(tables):
        file.complain("unconnected", coils=unconnected)
    check_circuit_names([circuit.name for circuit in circuits], file.problems)
    return tuple(circuits), tuple((coils | connected).values())


def circuit_names(file: Reading) -> list[str]:
    """Those of the file, also where something is wrong in a circuit."""
    return [*(table_at(file.data, "circuits") or table_at(file.data, "coils"))]


def check_circuit_names(names: Sequence[str], problems: list[str]) -> None:
    """Report names of which two readings of impedances, as of :mod:`femfit.model.impedance`, have one column."""
    pairs = [f"{first}_{second}{end}" for first, second in permutations(names, 2) for end in ("", "_shorted")]
    column, count = Counter((*names, *pairs)).most_common(1)[0] if names else ("", 1)
    if count > 1:
        complain(problems, "columns", column=column)


def _connected(
    file: Reading, members: Sequence[str], circuit: str, coils: Mapping[str, Coil], connected: dict[str, Coil]
) -> Iterator[Coil]:
    """The coils of a circuit, which join those that are connected already."""
    path = joined("circuits", circuit)
    for stated in members:
        name, sign = (stated[1:], -1.0) if stated.startswith("-") else (stated, 1.0)
        if name not in (drawn := table_at(file.data, "coils")):
            refuse_name(file.problems, "no_coil", path, stated, drawn)
        elif name in connected:
            file.complain("coil_twice", path, coil=name, owner=joined("circuits", connected[name].circuit))
        elif name in coils:
            connected[name] = replace(coils[name], circuit=circuit, sign=sign)
            yield connected[name]


def _check_driver(file: Reading, path: str, low: float | None, high: float | None, diode: float | None) -> None:
    _check_ascent(file, path, voltage_min_V=low, voltage_max_V=high)
    if low is not None and high is not None and diode is not None and low < 0.0:
        file.complain("diode", path, least=low)


def _check_ascent(file: Reading, path: str, **limits: float | None) -> None:
    """Report two limits, by their keys, of which the first is not the lower one."""
    (low, least), (high, most) = limits.items()
    if least is not None and most is not None and least >= most:
        file.complain("exchanged", path, low=low, high=high, least=least, most=most)


def read_mechanics(file: Reading) -> Mechanics | None:
    """The mechanics with its springs and stops; None if something is wrong."""
    entries = file.entries
    mechanics: Mechanics | None = entries.get("mechanics")
    if mechanics is None:
        return None
    places = [joined("mechanics.springs", name) for name in table_at(file.data, "mechanics", "springs")]
    stops = {key: entries[f"mechanics.{key}"] for key in ("near_stop", "far_stop") if f"mechanics.{key}" in entries}
    springs = tuple(entries[path] for path in places if path in entries)
    mechanics = replace(mechanics, springs=springs, **stops)
    near, far = (1e3 * end for end in mechanics.ends)
    if near >= far:
        file.complain("stops", near=near, far=far)
    return mechanics


def read_sensors(file: Reading, circuits: Sequence[str]) -> Iterator[AnySensor]:
    """All sensors in the file's order, with what they are placed on: a winding, or a circuit."""
    for name, table in table_at(file.data, "sensors").items():
        path = joined("sensors", name)
        sensor: AnySensor | None = file.entries.get(path)
        if isinstance(sensor, PickupCoil):
            drawn = outline(read_part(Outline, table), path, file.problems)
            corners = () if drawn is None else flattened(drawn.corners, drawn.bulges)
            sensor = replace(sensor, vertices_m=converted(corners, -3))
        elif isinstance(sensor, CurrentSensor) and "circuit" not in table:
            if len(circuits) > 1 or not any(body.winding for body in part_tables(file.data)):
                file.complain("no_circuit", path, known=", ".join(circuits) or "none")
            sensor = replace(sensor, circuit="".join(circuits[:1]))
        elif isinstance(sensor, CurrentSensor) and sensor.circuit not in circuits:
            refuse_name(file.problems, "which_circuit", path, sensor.circuit, circuits)
        if sensor is not None:
            yield sensor


def read_axes(file: Reading, circuits: Sequence[str]) -> tuple[list[tuple[float, ...]], tuple[float, ...]]:
    """The currents in A of each of these circuits, and the distances in mm; empty where they are unusable."""
    sweep = file.data.get("sweep")
    if not isinstance(sweep, dict):
        return [], ()
    currents, wound = sweep.get("current_A"), any(table.winding for table in part_tables(file.data))
    by_circuit = isinstance(currents, dict) and not currents.keys() <= keys_of(RangeEntry).keys()
    shared = {key: value for key, value in sweep.items() if key != "current_A" or (wound and not by_circuit)}
    entry, axes = read_entry(SweepEntry, shared, "sweep", file.problems), []
    if by_circuit:
        axes = list(_by_circuit(file, currents, circuits))
    elif wound and currents is None:
        file.complain("missing", "sweep.current_A", remedy=keys_of(SweepEntry)["current_A"].remedy)
    elif wound:
        if len(circuits) > 1:
            file.complain("each_current", known=", ".join(circuits), first=circuits[0], second=circuits[1])
        axes = [tuple(entry.current_A or ())]
    distances_mm = () if "distance_mm" in entry.wrong else tuple(entry.distance_mm)
    if distances_mm and distances_mm[0] < MIN_DISTANCE and file.data.is_schema_1:
        file.complain("no_gap", start=distances_mm[0], least=MIN_DISTANCE)
    return axes, distances_mm


def _by_circuit(file: Reading, currents: Any, circuits: Sequence[str]) -> Iterator[tuple[float, ...]]:
    for name in (name for name in currents if name not in circuits):
        refuse_name(file.problems, "not_a_circuit", joined("sweep.current_A", name), name, circuits)
    for name in circuits:
        path = joined("sweep.current_A", name)
        if name in currents:
            yield tuple(read_value(keys_of(SweepEntry)["current_A"], currents[name], path, file.problems) or ())
        else:
            file.complain("missing", path, remedy="Give the circuit's currents.")
