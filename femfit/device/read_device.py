"""Windings, circuits, mechanics and sensors of an actuator file, from its right tables by their key paths."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from math import inf
from typing import Any

from femfit.device.complaints import complain, did_you_mean, joined, read_part, table_at
from femfit.device.drawing import Drawing, DrawnPart
from femfit.device.electrics import AnySensor, Circuit, CurrentSensor, Drive, HallElement, PickupCoil
from femfit.device.keys import Given, OutlineEntry, scaled
from femfit.device.mechanics import Mechanics
from femfit.device.outlines import flattened, outline
from femfit.device.parts import REFERENCE_TEMPERATURE, Coil, smallest_winding_area, wire_resistance
from femfit.device.schema import CircuitEntry, CoilEntry, SupplyEntry

Tables = Mapping[str, Any]


def read_coils(entries: Tables, drawing: Drawing, problems: list[str]) -> tuple[Coil, ...]:
    """The windings whose tables are right, in the file's order."""
    drawn = [winding for winding in drawing.windings if winding.path in entries]
    coils = [_coil(entries[winding.path], winding, problems) for winding in drawn]
    return tuple(coil for coil in coils if coil is not None)


def _coil(entry: CoilEntry, winding: DrawnPart, problems: list[str]) -> Coil | None:
    path, name, polygon = winding.path, winding.name, winding.polygon
    diameter = entry.wire_diameter_mm
    needed = 0.0 if diameter is None else smallest_winding_area(entry.turns, diameter)
    if needed > polygon.area:
        complain(problems, "wire", path, turns=entry.turns, wire=diameter, needed=needed, area=polygon.area)
    resistance, temperature = entry.resistance_ohm, REFERENCE_TEMPERATURE
    if resistance is None:
        if diameter is None:
            complain(problems, "resistance", path)
            return None
        temperature = entry.temperature_C
        resistance = wire_resistance(entry.turns, polygon.centroid.x * 1e-3, diameter * 1e-3, temperature)
    outline = winding.outline  # its arcs become chords: nothing of a winding is singular at a corner
    corners = tuple((scaled(r), scaled(z)) for r, z in flattened(outline.corners, outline.bulges))
    wire = None if diameter is None else scaled(diameter)
    return Coil(corners, entry.turns, resistance, wire, name, winding.moves, circuit=name, temperature_C=temperature)


def read_circuits(
    data: Tables, entries: Tables, coils: Sequence[Coil], problems: list[str]
) -> tuple[tuple[Circuit, ...], tuple[Coil, ...]]:
    """The circuits in their order, without a table one a coil, and the coils as they are connected in them."""
    supply: SupplyEntry | None = entries.get("supply")
    usual = {key: getattr(supply, key, None) for key in ("voltage_min_V", "voltage_max_V", "diode_V")}
    low, high, diode_V = usual.values()
    _check_driver("supply", low, high, diode_V, problems)
    tables, by_name = table_at(data, "circuits"), {coil.name: coil for coil in coils}
    if coils and not tables and "supply" not in data:
        complain(problems, "no_supply")
    connected: dict[str, Coil] = {}
    circuits, count = [], len(problems)
    for name in tables or by_name:
        path = joined("circuits", name)
        entry: CircuitEntry | None = entries.get(path) if tables else CircuitEntry(coils=(name,))
        if entry is None:
            continue
        members = _connect(entry, name, by_name, connected, problems)
        resistance = sum(coil.resistance_ohm for coil in members) + entry.external_resistance_ohm
        low, high, diode_V = (usual[key] if getattr(entry, key) is None else getattr(entry, key) for key in usual)
        drive = Drive(diode_V=diode_V)
        if entry.kind == "current":
            drive = Drive("current", None, entry.current_min_A, entry.current_max_A, entry.bandwidth_Hz)
            least, most = drive.current_min_A, drive.current_max_A
            if least is None or most is None:
                complain(problems, "no_currents", path)
            elif least >= most:
                complain(problems, "exchanged", path, low="current_min_A", high="current_max_A", least=least, most=most)
        elif tables and None in (low, high) and (supply is not None or "supply" not in data):
            complain(problems, "no_voltages", path)
        if tables:
            _check_driver(path, low, high, entry.diode_V if entry.kind == "voltage" else None, problems)
        circuits.append(Circuit(resistance, *_open(low, high), drive, name, entry.external_inductance_H))
    unconnected = [coil for coil in by_name if coil not in connected]
    if unconnected and len(problems) == count and len(circuits) == len(tables):
        complain(problems, "unconnected", coils=", ".join(unconnected))
    return tuple(circuits), tuple(connected.get(coil.name, coil) for coil in coils)


def _open(low: float | None, high: float | None) -> tuple[float, float]:
    """Limits of a voltage, open where they are not known."""
    return (-inf, inf) if low is None or high is None else (low, high)


def check_circuit_names(names: Sequence[str], problems: list[str]) -> None:
    """Report names of which two readings of impedances, as of :mod:`femfit.model.impedance`, have one column."""
    pairs = [f"{first}_{second}{end}" for first, second in permutations(names, 2) for end in ("", "_shorted")]
    column, count = Counter((*names, *pairs)).most_common(1)[0] if names else ("", 1)
    if count > 1:
        complain(problems, "columns", column=column)


def _connect(
    entry: CircuitEntry, circuit: str, coils: Mapping[str, Coil], connected: dict[str, Coil], problems: list[str]
) -> list[Coil]:
    """The coils of a circuit, which join those that are connected already."""
    path, members = joined("circuits", circuit), []
    for stated in entry.coils:
        name, sign = (stated[1:], -1.0) if stated.startswith("-") else (stated, 1.0)
        if name not in coils:
            near, known = did_you_mean(name, coils), ", ".join(coils) or "none"
            complain(problems, "no_coil", path, given=stated[:60], near=near, known=known)
        elif name in connected:
            complain(problems, "coil_twice", path, coil=name, owner=joined("circuits", connected[name].circuit))
        else:
            connected[name] = replace(coils[name], circuit=circuit, sign=sign)
            members.append(connected[name])
    return members


def _check_driver(path: str, low: float | None, high: float | None, diode: float | None, problems: list[str]) -> None:
    if low is None or high is None:
        return
    if low >= high:
        complain(problems, "exchanged", path, low="voltage_min_V", high="voltage_max_V", least=low, most=high)
    if diode is not None and low < 0.0:
        complain(problems, "diode", path, least=low)


def read_mechanics(data: Tables, entries: Tables, problems: list[str]) -> Mechanics | None:
    """The mechanics, of which schema 1 has the mass alone; None if something is wrong."""
    mechanics: Mechanics | None = entries.get("mechanics")
    if mechanics is None:
        mass = entries["moving"].mass_g if "moving" in entries and "mechanics" not in data else None
        return None if mass is None else Mechanics(scaled(mass))
    places = [joined("mechanics.springs", name) for name in table_at(data, "mechanics", "springs")]
    stops = {key: entries[f"mechanics.{key}"] for key in ("near_stop", "far_stop") if f"mechanics.{key}" in entries}
    springs = tuple(entries[place] for place in places if place in entries)
    mechanics = replace(mechanics, springs=springs, **stops)
    near, far = (1e3 * end for end in mechanics.ends)
    if near >= far:
        complain(problems, "stops", near=near, far=far)
        return None
    return mechanics


def _sensor_tables(data: Tables) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Place and table of each sensor, ``[hall]`` first."""
    if "hall" in data:
        yield ("hall",), data["hall"]
    yield from ((("sensors", name), table) for name, table in table_at(data, "sensors").items())


def read_sensors(
    data: Tables, entries: Tables, circuits: Sequence[Circuit], problems: list[str]
) -> tuple[AnySensor, ...]:
    """All sensors in the file's order, ``[hall]`` first."""
    if "hall" in data and "hall" in table_at(data, "sensors"):
        complain(problems, "sensor_twice", name="hall")
    tables = ((joined("", *place), table) for place, table in _sensor_tables(data))
    return tuple(_placed(entries[path], path, table, circuits, problems) for path, table in tables if path in entries)


def hall_places(data: Tables) -> Iterator[tuple[tuple[str, ...], Given]]:
    """Place of the table and in the drawing of each Hall element whose place is right, whatever else of it is wrong."""
    for place, table in _sensor_tables(data):
        element = read_part(HallElement, table, "r_mm", "z_mm")
        if element is not None and (place[0] == "hall" or table.get("kind") == "hall"):
            yield place, element


def _placed(sensor: AnySensor, path: str, table: Any, circuits: Sequence[Circuit], problems: list[str]) -> AnySensor:
    """A sensor with the outline of its winding, or the circuit whose current it reads."""
    if isinstance(sensor, PickupCoil):
        drawn = outline(read_part(OutlineEntry, table), path, problems)
        corners = () if drawn is None else flattened(drawn.corners, drawn.bulges)
        return replace(sensor, vertices_m=tuple((scaled(r), scaled(z)) for r, z in corners))
    names = [circuit.name for circuit in circuits]
    if isinstance(sensor, CurrentSensor) and "circuit" not in table:
        if len(names) != 1:
            complain(problems, "no_circuit", path, count=len(names), known=", ".join(names) or "none")
        return replace(sensor, circuit=names[0] if names else "")
    if isinstance(sensor, CurrentSensor) and sensor.circuit not in names:
        near, known = did_you_mean(sensor.circuit, names), ", ".join(names) or "none"
        complain(problems, "which_circuit", path, given=sensor.circuit[:60], near=near, known=known)
    return sensor
