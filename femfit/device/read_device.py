"""Windings, circuits, driver and mechanics of an actuator file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise, permutations
from math import inf, isfinite
from typing import Any

from femfit.core.numerics import GRAVITY
from femfit.device.complaints import did_you_mean, joined, read_table
from femfit.device.decimals import scaled
from femfit.device.drawing import Drawing, DrawnWinding, check_name, coil_tables, table_at
from femfit.device.electrics import Circuit, Drive
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
from femfit.device.outlines import flattened
from femfit.device.parts import REFERENCE_TEMPERATURE, Coil, smallest_winding_area, wire_resistance
from femfit.device.schema import CoilEntry, MovingEntry, SupplyEntry
from femfit.device.schema_device import CircuitEntry, MechanicsEntry, SpringEntry, StopEntry, WindingEntry


def read_coils(data: Mapping[str, Any], drawing: Drawing, problems: list[str]) -> tuple[Coil, ...]:
    """The windings whose tables are right, in the file's order."""
    drawn = {winding.part.path: winding for winding in drawing.windings}
    coils = []
    for path, table in coil_tables(data):
        entry = read_table(CoilEntry if path == "coil" else WindingEntry, table, path, problems)
        if entry is not None and path in drawn:
            coils.append(_coil(entry, drawn[path], problems))
    return tuple(coil for coil in coils if coil is not None)


def _coil(entry: CoilEntry, winding: DrawnWinding, problems: list[str]) -> Coil | None:
    path = winding.part.path
    polygon = winding.part.polygon
    if entry.wire_diameter_mm is not None:
        needed = smallest_winding_area(entry.turns, entry.wire_diameter_mm)
        if needed > polygon.area:
            problems.append(
                f"{path}.wire_diameter_mm must let the turns fit; {entry.turns:g} turns of {entry.wire_diameter_mm:g} "
                f"mm need at least {needed:.4g} mm^2 and the winding has {polygon.area:.4g} mm^2. "
                "Take fewer turns, a thinner wire or a larger winding."
            )
    resistance, temperature = entry.resistance_ohm, REFERENCE_TEMPERATURE
    if resistance is None:
        if entry.wire_diameter_mm is None:
            problems.append(
                f"{path}.resistance_ohm is missing, and so is wire_diameter_mm to have it from. Give one of the two."
            )
            return None
        temperature = entry.temperature_C
        resistance = wire_resistance(entry.turns, polygon.centroid.x * 1e-3, entry.wire_diameter_mm * 1e-3, temperature)
    outline = winding.part.outline  # its arcs become chords: nothing of a winding is singular at a corner
    corners = tuple((scaled(r), scaled(z)) for r, z in flattened(outline.corners, outline.bulges))
    diameter = None if entry.wire_diameter_mm is None else scaled(entry.wire_diameter_mm)
    name = winding.part.name
    return Coil(
        corners, entry.turns, resistance, diameter, name, winding.moves, circuit=name, temperature_C=temperature
    )


def read_supply(data: Mapping[str, Any], problems: list[str]) -> SupplyEntry | None:
    """The driver of the circuits without one of their own, and the controller's period."""
    if not isinstance(data.get("supply"), dict):
        return None
    entry = read_table(SupplyEntry, data["supply"], "supply", problems)
    if entry is not None:
        _check_limits("supply", "voltage", "V", entry.voltage_min_V, entry.voltage_max_V, problems)
        _check_diode("supply", entry.diode_V, entry.voltage_min_V, problems)
    return entry


def read_circuits(
    data: Mapping[str, Any], coils: Sequence[Coil], supply: SupplyEntry | None, problems: list[str]
) -> tuple[tuple[Circuit, ...], tuple[Coil, ...]]:
    """The circuits in their order, without a table one a coil, and the coils as they are connected in them."""
    tables, diode_V = table_at(data, "circuits"), supply.diode_V if supply is not None else None
    if not tables:
        if coils and supply is None and "supply" not in data:
            problems.append("supply is missing. Give the driver as a table [supply], or limits in [circuits.NAME].")
        limits = (-inf, inf) if supply is None else (supply.voltage_min_V, supply.voltage_max_V)
        drive = Drive(diode_V=diode_V)
        return tuple(Circuit(coil.resistance_ohm, *limits, drive, coil.name) for coil in coils), tuple(coils)
    by_name = {coil.name: coil for coil in coils}
    connected: dict[str, Coil] = {}
    circuits, count = [], len(problems)
    for name, table in tables.items():
        path = joined("circuits", name)
        check_name(name, path, problems)
        entry = read_table(CircuitEntry, table, path, problems)
        if entry is None:
            continue
        members = _connect(entry, name, by_name, connected, problems)
        limits = _voltages(entry, path, supply, "supply" in data, problems)
        drive = _drive(entry, path, limits[0], diode_V, problems)
        resistance = sum(coil.resistance_ohm for coil in members) + entry.external_resistance_ohm
        circuits.append(Circuit(resistance, *limits, drive, name, scaled(entry.external_inductance_mH)))
    unconnected = [coil for coil in by_name if coil not in connected]
    if unconnected and len(problems) == count:
        problems.append(
            f"circuits must connect every coil; {', '.join(unconnected)} is in none. Name it in one of them."
        )
    return tuple(circuits), tuple(connected.get(coil.name, coil) for coil in coils)


def check_circuit_names(names: Sequence[str], problems: list[str]) -> None:
    """Report names of which two readings of impedances, as of :mod:`femfit.model.impedance`, have one column."""
    of_reading = {name: f"circuit {name}" for name in names}
    for first, second in permutations(names, 2):
        for column, description in (
            (f"{first}_{second}", f"{first} together with {second}"),
            (f"{first}_{second}_shorted", f"{first} with {second} shorted"),
        ):
            if column in of_reading:
                problems.append(
                    f"Names of circuits must keep columns apart; inductance_{column}_H would be that of "
                    f"{of_reading[column]} and that of {description}. Rename one of them."
                )
                return
            of_reading[column] = description


def _connect(
    entry: CircuitEntry, circuit: str, coils: Mapping[str, Coil], connected: dict[str, Coil], problems: list[str]
) -> list[Coil]:
    """The coils of a circuit, which join those that are connected already."""
    path, members = joined("circuits", circuit), []
    for entry_coil in entry.coils:
        name, sign = (entry_coil[1:], -1.0) if entry_coil.startswith("-") else (entry_coil, 1.0)
        if name not in coils:
            problems.append(
                f"{path}.coils must name coils of this file; {entry_coil[:60]!r} is none.{did_you_mean(name, coils)} "
                f"Known: {', '.join(coils) or 'none'}."
            )
        elif name in connected:
            owner = joined("circuits", connected[name].circuit)
            problems.append(f"{path}.coils must leave out {name}, which is in {owner}. Name it in one alone.")
        else:
            connected[name] = replace(coils[name], circuit=circuit, sign=sign)
            members.append(connected[name])
    return members


def _voltages(
    entry: CircuitEntry, path: str, supply: SupplyEntry | None, has_voltage: bool, problems: list[str]
) -> tuple[float, float]:
    """The limits of a circuit, or else the supply's; behind a current amplifier they may be open."""
    low = entry.voltage_min_V if entry.voltage_min_V is not None or supply is None else supply.voltage_min_V
    high = entry.voltage_max_V if entry.voltage_max_V is not None or supply is None else supply.voltage_max_V
    if low is None or high is None:
        if entry.drive == "voltage" and (supply is not None or not has_voltage):
            problems.append(
                f"{path} must have voltage_min_V and voltage_max_V, or the file [supply]. Give one of them."
            )
        return -inf, inf
    _check_limits(path, "voltage", "V", low, high, problems)
    return low, high


def _drive(entry: CircuitEntry, path: str, lowest_V: float, diode_V: float | None, problems: list[str]) -> Drive:
    if entry.drive == "voltage":
        if isfinite(lowest_V):
            _check_diode(path, entry.diode_V, lowest_V, problems)
        return Drive(diode_V=entry.diode_V if entry.diode_V is not None else diode_V)
    low, high = entry.current_min_A, entry.current_max_A
    if low is None or high is None:
        problems.append(
            f'{path}.current_min_A and current_max_A must be given for drive = "current". Give the amplifier\'s limits.'
        )
    else:
        _check_limits(path, "current", "A", low, high, problems)
    return Drive("current", None, low, high, entry.bandwidth_Hz)


def _check_limits(path: str, what: str, unit: str, low: float, high: float, problems: list[str]) -> None:
    if low >= high:
        problems.append(
            f"{path}.{what}_min_{unit} must be below {what}_max_{unit}; they are {low:g} and {high:g}. "
            "Exchange or change them."
        )


def _check_diode(path: str, diode: float | None, low: float, problems: list[str]) -> None:
    if diode is not None and low < 0.0:
        problems.append(
            f"{path}.diode_V must be left out where voltage_min_V is negative ({low:g}): a bridge takes the current "
            "back itself. Remove it, or give voltage_min_V = 0."
        )


DOWNWARD = {"hanging": 1.0, "standing": -1.0, "horizontal": 0.0, "off": 0.0}
"""Share of gravity along growing distance."""


def read_mechanics(data: Mapping[str, Any], body: MovingEntry | None, problems: list[str]) -> Mechanics | None:
    """The mechanics, of which schema 1 has the mass alone; None if something is wrong."""
    mass = body.mass_g if body is not None else None
    table = data.get("mechanics")
    if not isinstance(table, dict):
        if body is not None and mass is None:
            problems.append("moving.mass_g is missing. Give the mass of the whole moving body in grams.")
        return None if mass is None else Mechanics(scaled(mass))
    if mass is not None and "mass_g" in table:
        problems.append("mechanics.mass_g must be left out beside moving.mass_g. Remove one of them.")
    count = len(problems)
    entry = read_table(MechanicsEntry, ({} if mass is None else {"mass_g": mass}) | table, "mechanics", problems)
    if entry is None:
        return None
    springs = [_spring(joined("mechanics.springs", name), spring, problems) for name, spring in entry.springs.items()]
    near, far = _stops(entry, problems)
    gravity = _gravity(entry, problems)
    if len(problems) > count:
        return None
    return Mechanics(
        mass_kg=scaled(entry.mass_g),
        gravity_m_s2=gravity,
        springs=tuple(spring for spring in springs if spring is not None),
        viscous_N_s_per_m=entry.viscous_N_s_per_m,
        coulomb_N=entry.coulomb_N,
        load_N=entry.load_N,
        near_stop=near,
        far_stop=far,
    )


def check_travel(mechanics: Mechanics, distances: Sequence[float], problems: list[str]) -> None:
    """Report stops that keep the body away from all distances of the sweep, in mm."""
    near, far = (1e3 * end for end in mechanics.ends)
    if distances and (near > distances[-1] + 1e-9 or far < distances[0] - 1e-9):
        name, place = ("near_stop", near) if near > distances[-1] else ("far_stop", far)
        problems.append(
            f"mechanics.{name} must leave distances of the sweep, {distances[0]:g} to {distances[-1]:g} mm, to the "
            f"body; it is at {place:g} mm. Sweep beyond it, or move it."
        )


def _gravity(entry: MechanicsEntry, problems: list[str]) -> float:
    if entry.gravity is not None and entry.gravity_deg is not None:
        problems.append("mechanics must have either gravity or gravity_deg; it has both. Remove one.")
    if entry.gravity_deg is not None:
        return round(GRAVITY * math.cos(math.radians(entry.gravity_deg)), 12)
    return GRAVITY * DOWNWARD[entry.gravity or "hanging"]


def _spring(path: str, table: object, problems: list[str]) -> Spring | ForceTable | None:
    entry = read_table(SpringEntry, table, path, problems)
    if entry is None:
        return None
    if entry.stiffness_N_per_mm is not None and entry.force_N is None and entry.distance_mm is None:
        if entry.preload_N and entry.preload_at_mm is None:
            problems.append(
                f"{path}.preload_at_mm is missing. Give the distance at which the spring has its preload_N."
            )
        return Spring(1e3 * entry.stiffness_N_per_mm, entry.preload_N, scaled(entry.preload_at_mm or 0.0))
    if entry.stiffness_N_per_mm is not None or entry.distance_mm is None or entry.force_N is None:
        problems.append(
            f"{path} must have either stiffness_N_per_mm or a table of distance_mm and force_N. Give one of the two."
        )
        return None
    if len(entry.distance_mm) != len(entry.force_N):
        problems.append(
            f"{path}.force_N must have as many values as distance_mm; they are {len(entry.force_N)} and "
            f"{len(entry.distance_mm)}. Complete the list."
        )
        return None
    if any(after <= before for before, after in pairwise(entry.distance_mm)):
        problems.append(f"{path}.distance_mm must ascend without repeats. Sort it, with its forces.")
        return None
    return ForceTable(tuple(scaled(d) for d in entry.distance_mm), tuple(entry.force_N))


def _stops(entry: MechanicsEntry, problems: list[str]) -> tuple[Stop | None, Stop | None]:
    near = _stop("mechanics.near_stop", entry.near_stop, problems)
    far = _stop("mechanics.far_stop", entry.far_stop, problems)
    if entry.travel_mm is not None:
        if near is not None or far is not None:
            problems.append("mechanics.travel_mm must be left out beside near_stop and far_stop. Remove one of them.")
        near, far = (Stop(scaled(distance)) for distance in entry.travel_mm)
    if near is not None and far is not None and near.distance_m >= far.distance_m:
        problems.append(
            f"mechanics must have its near stop below its far one; they are at {1e3 * near.distance_m:g} and "
            f"{1e3 * far.distance_m:g} mm. Exchange or change them."
        )
    return near, far


def _stop(path: str, table: object, problems: list[str]) -> Stop | None:
    entry = None if table is None else read_table(StopEntry, table, path, problems)
    if entry is None:
        return None
    stiffness = None if entry.stiffness_N_per_mm is None else 1e3 * entry.stiffness_N_per_mm
    return Stop(scaled(entry.distance_mm), entry.restitution, stiffness)
