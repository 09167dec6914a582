"""Windings, circuits and mechanics of an actuator file, from its right tables by their key paths."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from math import inf
from typing import Any

from femfit.core.numerics import GRAVITY
from femfit.device.checks import DrawnPart
from femfit.device.complaints import did_you_mean, joined, table_at
from femfit.device.decimals import in_si, scaled
from femfit.device.drawing import Drawing
from femfit.device.electrics import Circuit, Drive
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
from femfit.device.outlines import flattened
from femfit.device.parts import REFERENCE_TEMPERATURE, Coil, smallest_winding_area, wire_resistance
from femfit.device.schema import CoilEntry, SupplyEntry
from femfit.device.schema_device import CircuitEntry, MechanicsEntry, SpringEntry


def read_coils(entries: Mapping[str, Any], drawing: Drawing, problems: list[str]) -> tuple[Coil, ...]:
    """The windings whose tables are right, in the file's order."""
    drawn = [winding for winding in drawing.windings if winding.path in entries]
    coils = [_coil(entries[winding.path], winding, problems) for winding in drawn]
    return tuple(coil for coil in coils if coil is not None)


def _coil(entry: CoilEntry, winding: DrawnPart, problems: list[str]) -> Coil | None:
    path, name, polygon = winding.path, winding.name, winding.polygon
    diameter = entry.wire_diameter_mm
    needed = 0.0 if diameter is None else smallest_winding_area(entry.turns, diameter)
    if needed > polygon.area:
        problems.append(
            f"{path}.wire_diameter_mm must let the turns fit; {entry.turns:g} turns of {diameter:g} mm need at least "
            f"{needed:.4g} mm^2 and the winding has {polygon.area:.4g} mm^2. Take fewer turns, a thinner wire or a "
            "larger winding."
        )
    resistance, temperature = entry.resistance_ohm, REFERENCE_TEMPERATURE
    if resistance is None:
        if diameter is None:
            problems.append(
                f"{path}.resistance_ohm is missing, and so is wire_diameter_mm to have it from. Give one of the two."
            )
            return None
        temperature = entry.temperature_C
        resistance = wire_resistance(entry.turns, polygon.centroid.x * 1e-3, diameter * 1e-3, temperature)
    outline = winding.outline  # its arcs become chords: nothing of a winding is singular at a corner
    corners = tuple((scaled(r), scaled(z)) for r, z in flattened(outline.corners, outline.bulges))
    wire = None if diameter is None else scaled(diameter)
    return Coil(corners, entry.turns, resistance, wire, name, winding.moves, circuit=name, temperature_C=temperature)


def read_circuits(
    data: Mapping[str, Any], entries: Mapping[str, Any], coils: Sequence[Coil], problems: list[str]
) -> tuple[tuple[Circuit, ...], tuple[Coil, ...]]:
    """The circuits in their order, without a table one a coil, and the coils as they are connected in them."""
    supply: SupplyEntry | None = entries.get("supply")
    if supply is not None:
        _check_driver("supply", supply.voltage_min_V, supply.voltage_max_V, supply.diode_V, problems)
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
    for name in tables:
        entry = entries.get(path := joined("circuits", name))
        if entry is None:
            continue
        members = _connect(entry, name, by_name, connected, problems)
        resistance = sum(coil.resistance_ohm for coil in members) + entry.external_resistance_ohm
        limits = _voltages(entry, path, supply, "supply" in data, problems)
        drive = _drive(entry, path, diode_V, problems)
        circuits.append(Circuit(resistance, *limits, drive, name, scaled(entry.external_inductance_mH)))
    unconnected = [coil for coil in by_name if coil not in connected]
    if unconnected and len(problems) == count and len(circuits) == len(tables):
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
    if low is not None and high is not None:
        _check_driver(path, low, high, entry.diode_V if entry.drive == "voltage" else None, problems)
        return low, high
    if entry.drive == "voltage" and (supply is not None or not has_voltage):
        problems.append(f"{path} must have voltage_min_V and voltage_max_V, or the file [supply]. Give one of them.")
    return -inf, inf


def _drive(entry: CircuitEntry, path: str, diode_V: float | None, problems: list[str]) -> Drive:
    if entry.drive == "voltage":
        return Drive(diode_V=entry.diode_V if entry.diode_V is not None else diode_V)
    low, high = entry.current_min_A, entry.current_max_A
    if low is None or high is None:
        problems.append(
            f'{path}.current_min_A and current_max_A must be given for drive = "current". Give the amplifier\'s limits.'
        )
    elif low >= high:
        problems.append(_EXCHANGED.format(path, "current", "A", low, high))
    return Drive("current", None, low, high, entry.bandwidth_Hz)


def _check_driver(path: str, low: float, high: float, diode: float | None, problems: list[str]) -> None:
    if low >= high:
        problems.append(_EXCHANGED.format(path, "voltage", "V", low, high))
    if diode is not None and low < 0.0:
        problems.append(
            f"{path}.diode_V must be left out where voltage_min_V is negative ({low:g}): a bridge takes the current "
            "back itself. Remove it, or give voltage_min_V = 0."
        )


_EXCHANGED = "{0}.{1}_min_{2} must be below {1}_max_{2}; they are {3:g} and {4:g}. Exchange or change them."

DOWNWARD = {"hanging": 1.0, "standing": -1.0, "horizontal": 0.0, "off": 0.0}
"""Share of gravity along growing distance."""


def read_mechanics(data: Mapping[str, Any], entries: Mapping[str, Any], problems: list[str]) -> Mechanics | None:
    """The mechanics, of which schema 1 has the mass alone; None if something is wrong."""
    entry: MechanicsEntry | None = entries.get("mechanics")
    if entry is None:
        mass = entries["moving"].mass_g if "moving" in entries and "mechanics" not in data else None
        return None if mass is None else Mechanics(scaled(mass))
    places = [joined("mechanics.springs", name) for name in entry.springs]
    stops = [entries.get(f"mechanics.{key}") for key in ("near_stop", "far_stop")]
    near, far = (None if stop is None else Stop(**in_si(stop)) for stop in stops)
    if entry.travel_mm is not None:
        near, far = (Stop(scaled(distance)) for distance in entry.travel_mm)
    if near is not None and far is not None and near.distance_m >= far.distance_m:
        problems.append(
            f"mechanics must have its near stop below its far one; they are at {1e3 * near.distance_m:g} and "
            f"{1e3 * far.distance_m:g} mm. Exchange or change them."
        )
        return None
    gravity = GRAVITY * DOWNWARD[entry.gravity or "hanging"]
    if entry.gravity_deg is not None:
        gravity = round(GRAVITY * math.cos(math.radians(entry.gravity_deg)), 12)
    return Mechanics(
        gravity_m_s2=gravity,
        springs=tuple(_spring(entries[place]) for place in places if place in entries),
        near_stop=near,
        far_stop=far,
        **in_si(entry, "gravity", "gravity_deg", "travel_mm", "springs", "near_stop", "far_stop"),
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


def _spring(entry: SpringEntry) -> Spring | ForceTable:
    if entry.distance_mm is not None:
        return ForceTable(tuple(map(scaled, entry.distance_mm)), tuple(entry.force_N or ()))
    return Spring(1e3 * (entry.stiffness_N_per_mm or 0.0), entry.preload_N, scaled(entry.preload_at_mm or 0.0))
