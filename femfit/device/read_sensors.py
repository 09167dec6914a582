"""The sensors of an actuator file: ``[hall]``, and ``[sensors.NAME]`` of every kind."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from femfit.device.complaints import did_you_mean, joined, read_part, read_table
from femfit.device.decimals import scaled
from femfit.device.drawing import check_name, table_at, unit_vector
from femfit.device.electrics import (
    AccelerationSensor,
    AnySensor,
    Circuit,
    CurrentSensor,
    ForceSensor,
    HallElement,
    PickupCoil,
    PositionSensor,
)
from femfit.device.outlines import flattened, outline
from femfit.device.schema import HallEntry, HallPlace
from femfit.device.schema_device import (
    AccelerationSensorEntry,
    CurrentSensorEntry,
    ForceSensorEntry,
    PickupCoilEntry,
    PositionSensorEntry,
    SensorTiming,
)

DIRECTIONS = {"z": (0.0, 1.0), "r": (1.0, 0.0)}


def read_sensors(data: Mapping[str, Any], circuits: Sequence[Circuit], problems: list[str]) -> tuple[AnySensor, ...]:
    """All sensors in the file's order, ``[hall]`` first."""
    sensors: list[AnySensor | None] = []
    if isinstance(data.get("hall"), dict):
        sensors.append(_hall("hall", "hall", data["hall"], problems))
    for name, table in table_at(data, "sensors").items():
        path = joined("sensors", name)
        check_name(name, path, problems)
        kind = table.get("kind") if isinstance(table, dict) else None
        if not isinstance(table, dict):
            problems.append(f"{path} must be a table. Give each sensor as [sensors.NAME] with its kind.")
        elif not isinstance(kind, str) or kind not in KINDS:
            problems.append(
                f"{path}.kind must be one of {', '.join(KINDS)}; it is {str(kind)[:60]!r}."
                f"{did_you_mean(str(kind), KINDS)} Give one of them."
            )
        elif kind == "hall":
            sensors.append(_hall(path, name, table, problems))
        elif kind == "current":
            sensors.append(_current(path, name, table, circuits, problems))
        else:
            sensors.append(_READ[kind](path, name, table, problems))
    names = [sensor.name for sensor in sensors if sensor is not None]
    problems += [
        f"sensors.{name} must have a name of its own; [hall] is named {name}. Rename it."
        for name in sorted({name for name in names if names.count(name) > 1})
    ]
    return tuple(sensor for sensor in sensors if sensor is not None)


def hall_places(data: Mapping[str, Any]) -> Iterator[tuple[str, HallPlace]]:
    """Key path and place of each Hall element whose place is right, whatever else of it is wrong."""
    tables = {"hall": data.get("hall")}
    for name, table in table_at(data, "sensors").items():
        if isinstance(table, dict) and table.get("kind") == "hall":
            tables[joined("sensors", name)] = table
    for path, table in tables.items():
        place = read_part(HallPlace, table)
        if place is not None:
            yield path, place


def _hall(path: str, name: str, table: dict[str, Any], problems: list[str]) -> HallElement | None:
    entry = read_table(HallEntry, table, path, problems)
    if entry is None:
        return None
    _check_hall_output(path, entry, problems)
    vector = entry.direction
    direction = DIRECTIONS[vector] if isinstance(vector, str) else unit_vector(vector, f"{path}.direction", problems)
    electrical = entry.model_dump(exclude={"r_mm", "z_mm", "kind", "direction", "delay_ms", "sample_time_ms"})
    return HallElement(
        radius_m=scaled(entry.r_mm),
        height_m=scaled(entry.z_mm),
        name=name,
        direction=direction or (0.0, 1.0),
        delay_s=scaled(entry.delay_ms),
        sample_time_s=None if entry.sample_time_ms is None else scaled(entry.sample_time_ms),
        **electrical,
    )


def _check_hall_output(path: str, hall: HallEntry, problems: list[str]) -> None:
    if hall.output_min_V >= hall.output_max_V:
        problems.append(
            f"{path}.output_min_V must be below output_max_V; they are {hall.output_min_V:g} and "
            f"{hall.output_max_V:g}. Exchange or change them."
        )
    elif not hall.output_min_V <= hall.quiescent_V <= hall.output_max_V:
        problems.append(
            f"{path}.quiescent_V must lie between output_min_V and output_max_V; it is {hall.quiescent_V:g} with "
            f"{hall.output_min_V:g} and {hall.output_max_V:g}. Change one of the three."
        )
    if hall.sensitivity_V_per_T == 0:
        problems.append(f"{path}.sensitivity_V_per_T must not be 0; nothing would be seen. Give it, or remove {path}.")


def _current(
    path: str, name: str, table: dict[str, Any], circuits: Sequence[Circuit], problems: list[str]
) -> CurrentSensor | None:
    entry = read_table(CurrentSensorEntry, table, path, problems)
    if entry is None:
        return None
    names = [circuit.name for circuit in circuits]
    if entry.circuit is None and len(names) != 1:
        problems.append(f"{path}.circuit is missing; there are {len(names)}. Name one of {', '.join(names) or 'none'}.")
        return None
    if entry.circuit is not None and entry.circuit not in names:
        problems.append(
            f"{path}.circuit must name a circuit of this file; it is {entry.circuit[:60]!r}."
            f"{did_you_mean(entry.circuit, names)} Known: {', '.join(names) or 'none'}."
        )
        return None
    return CurrentSensor(
        **_common(path, name, entry, entry.noise_A, entry.range_A, "range_A", problems),
        circuit=entry.circuit or names[0],
    )


def _position(path: str, name: str, table: dict[str, Any], problems: list[str]) -> PositionSensor | None:
    entry = read_table(PositionSensorEntry, table, path, problems)
    if entry is None:
        return None
    volts = entry.gain_V_per_mm is not None or entry.distance_mm is not None or entry.output_V is not None
    wrong = {"noise_mm", "range_mm"} if volts else {"noise_V", "range_V", "offset_V"}
    wrong &= entry.model_fields_set
    if wrong:
        remedy = (
            "Give noise_V and range_V." if volts else "Give gain_V_per_mm, or a characteristic, for an output in V."
        )
        problems.append(f"{path} must not have {' and '.join(sorted(wrong))} with these keys. {remedy}")
        return None
    if not volts:
        noise, limits = scaled(entry.noise_mm), entry.range_mm and [scaled(end) for end in entry.range_mm]
        common = _common(path, name, entry, noise, limits, "range_mm", problems)
        return PositionSensor(**common, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")
    points = _characteristic(path, entry, problems)
    common = _common(path, name, entry, entry.noise_V, entry.range_V, "range_V", problems)
    return None if points is None else PositionSensor(**common, distances_m=points[0], readings=points[1])


def _characteristic(
    path: str, entry: PositionSensorEntry, problems: list[str]
) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    if entry.gain_V_per_mm is not None:
        if entry.distance_mm is not None or entry.output_V is not None:
            problems.append(f"{path} must have either gain_V_per_mm or distance_mm and output_V. Remove one.")
            return None
        if entry.gain_V_per_mm == 0.0:
            problems.append(f"{path}.gain_V_per_mm must not be 0; nothing would be seen. Give the sensor's slope.")
            return None
        return (0.0, 1.0), (entry.offset_V, entry.offset_V + 1e3 * entry.gain_V_per_mm)
    distances, read = entry.distance_mm, entry.output_V
    if distances is None or read is None or len(distances) != len(read):
        problems.append(f"{path} must have distance_mm and output_V of one length. Give both lists.")
        return None
    rises = {after > before for before, after in pairwise(read)}
    if any(b <= a for a, b in pairwise(distances)) or len(rises) > 1 or any(b == a for a, b in pairwise(read)):
        problems.append(
            f"{path}.distance_mm must ascend and output_V rise or fall throughout, so that an output means one "
            "distance. Leave the part out where it turns."
        )
        return None
    return tuple(scaled(d) for d in distances), tuple(read)


def _pickup(path: str, name: str, table: dict[str, Any], problems: list[str]) -> PickupCoil | None:
    entry = read_table(PickupCoilEntry, table, path, problems)
    drawn = None if entry is None else outline(entry, path, problems)
    if entry is None or drawn is None:
        return None
    corners = tuple((scaled(r), scaled(z)) for r, z in flattened(drawn.corners, drawn.bulges))
    common = _common(path, name, entry, entry.noise_V, entry.range_V, "range_V", problems)
    return PickupCoil(**common, vertices_m=corners, turns=entry.turns, moves=entry.moves)


def _acceleration(path: str, name: str, table: dict[str, Any], problems: list[str]) -> AccelerationSensor | None:
    entry = read_table(AccelerationSensorEntry, table, path, problems)
    if entry is None:
        return None
    limits = entry.range_m_per_s2
    common = _common(path, name, entry, entry.noise_m_per_s2, limits, "range_m_per_s2", problems)
    return AccelerationSensor(**common, reads_gravity=entry.reads_gravity)


def _force(path: str, name: str, table: dict[str, Any], problems: list[str]) -> ForceSensor | None:
    entry = read_table(ForceSensorEntry, table, path, problems)
    if entry is None:
        return None
    return ForceSensor(**_common(path, name, entry, entry.noise_N, entry.range_N, "range_N", problems))


def _common(
    path: str,
    name: str,
    entry: SensorTiming,
    noise: float,
    limits: Sequence[float] | None,
    key: str,
    problems: list[str],
) -> dict[str, Any]:
    """What all sensors share, in SI units."""
    low, high = limits or (None, None)
    if low is not None and high is not None and low >= high:
        problems.append(f"{path}.{key} must ascend; it is [{low:g}, {high:g}]. Exchange or change the values.")
    if entry.bits and limits is None:
        problems.append(f"{path}.{key} is missing; {entry.bits} bits are divided over it. Give [lowest, highest].")
    return {
        "name": name,
        "noise": noise,
        "minimum": low,
        "maximum": high,
        "bits": entry.bits,
        "delay_s": scaled(entry.delay_ms),
        "sample_time_s": None if entry.sample_time_ms is None else scaled(entry.sample_time_ms),
    }


_READ: dict[str, Callable[[str, str, dict[str, Any], list[str]], AnySensor | None]] = {
    "position": _position,
    "pickup_coil": _pickup,
    "acceleration": _acceleration,
    "force": _force,
}

KINDS = ("hall", "current", *_READ)
"""Kinds of sensors that a file can have."""
