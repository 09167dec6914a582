"""The sensors of an actuator file: ``[hall]``, and ``[sensors.NAME]`` of every kind."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from femfit.device.complaints import did_you_mean, joined, read_part, table_at
from femfit.device.decimals import in_si, scaled, si_key
from femfit.device.drawing import unit_vector
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
    PickupCoilEntry,
    PositionSensorEntry,
    SensorTiming,
)


def _tables(data: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Key path, name and table of each sensor, ``[hall]`` first."""
    if "hall" in data:
        yield "hall", "hall", data["hall"]
    for name, table in table_at(data, "sensors").items():
        yield joined("sensors", name), name, table


def read_sensors(
    data: Mapping[str, Any], entries: Mapping[str, Any], circuits: Sequence[Circuit], problems: list[str]
) -> tuple[AnySensor, ...]:
    """All sensors in the file's order, ``[hall]`` first."""
    tables = list(_tables(data))
    names = [name for _, name, _ in tables]
    problems += [
        f"sensors.{name} must have a name of its own; [hall] is named {name}. Rename it."
        for name in sorted({name for name in names if names.count(name) > 1})
    ]
    sensors = [_sensor(path, name, entries[path], circuits, problems) for path, name, _ in tables if path in entries]
    return tuple(sensor for sensor in sensors if sensor is not None)


def hall_places(data: Mapping[str, Any]) -> Iterator[tuple[str, HallPlace]]:
    """Key path and place of each Hall element whose place is right, whatever else of it is wrong."""
    for path, _, table in _tables(data):
        place = read_part(HallPlace, table)
        if place is not None and (path == "hall" or table.get("kind") == "hall"):
            yield path, place


def _sensor(
    path: str, name: str, entry: HallEntry | SensorTiming, circuits: Sequence[Circuit], problems: list[str]
) -> AnySensor | None:
    values = in_si(entry)
    if isinstance(entry, HallEntry):
        values["direction"] = unit_vector(entry.direction, f"{path}.direction", problems) or (0.0, 1.0)
        return HallElement(radius_m=values.pop("r_m"), height_m=values.pop("z_m"), name=name, **values)
    key = si_key(entry.range_key)[0]
    minimum, maximum = values[key] or (None, None)
    common: dict[str, Any] = {"name": name, "noise": values[key.replace("range", "noise")]}
    common |= {"minimum": minimum, "maximum": maximum}
    common |= {key: values[key] for key in ("bits", "delay_s", "sample_time_s")}
    if isinstance(entry, CurrentSensorEntry):
        circuit = _circuit(path, entry, circuits, problems)
        return None if circuit is None else CurrentSensor(**common, circuit=circuit)
    if isinstance(entry, PositionSensorEntry):
        points, readings = values["distance_m"], values["output_V"]
        if points is None:  # Linear, or the distance itself
            points, slope = (0.0, 1.0), 1.0 if entry.gain_V_per_mm is None else 1e3 * entry.gain_V_per_mm
            readings = (entry.offset_V, entry.offset_V + slope)
        unit = "m" if entry.reads_distance else "V"
        return PositionSensor(**common, distances_m=points, readings=readings, unit=unit)
    if isinstance(entry, PickupCoilEntry):
        drawn = outline(entry, path, problems)
        corners = () if drawn is None else flattened(drawn.corners, drawn.bulges)
        vertices = tuple((scaled(r), scaled(z)) for r, z in corners)
        return PickupCoil(**common, vertices_m=vertices, turns=entry.turns, moves=entry.moves)
    if isinstance(entry, AccelerationSensorEntry):
        return AccelerationSensor(**common, reads_gravity=entry.reads_gravity)
    return ForceSensor(**common)


def _circuit(path: str, entry: CurrentSensorEntry, circuits: Sequence[Circuit], problems: list[str]) -> str | None:
    """The name of the circuit whose current is read."""
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
    return entry.circuit or names[0]
