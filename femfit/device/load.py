"""Read an actuator file: every problem at once, or the actuator in SI units."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from shapely import Polygon

from femfit.core.errors import ActuatorFileError
from femfit.core.paths import path_of
from femfit.device.checks import (
    DrawnPart,
    check_collisions,
    check_hall_place,
    check_moving_body,
    check_overlaps,
    check_thickness,
    check_zero_heights,
)
from femfit.device.complaints import AnyEntry, read_part, read_table
from femfit.device.decimals import axis_values, scaled
from femfit.device.drawing import Drawing, read_drawing
from femfit.device.parameter_table import read_design
from femfit.device.parts import AIR, Actuator, Coil, HallElement, MovingPart, Region, Supply, SweepAxes
from femfit.device.schema import (
    SCHEMA_VERSION,
    CoilEntry,
    CurrentAxis,
    DistanceAxis,
    ElectromagnetEntry,
    FileEntry,
    HallEntry,
    HallPlace,
    MovingEntry,
    ReferenceEntry,
    SolverEntry,
    SupplyEntry,
    SweepEntry,
)
from femfit.device.winding import smallest_winding_area, wire_resistance


def read_text(path: Path) -> str:
    """The text of an actuator file."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise ActuatorFileError(str(path), ["does not exist. Give the path of an actuator .toml file."]) from error
    except OSError as error:
        raise ActuatorFileError(str(path), [f"cannot be read: {error.strerror}."]) from error
    except UnicodeDecodeError as error:
        raise ActuatorFileError(str(path), [f"must be UTF-8 text; byte {error.start} is not. Save it so."]) from error


def parse(text: str, source: str) -> dict[str, Any]:
    """The tables of TOML text."""
    try:
        data = tomllib.loads(text)
    except RecursionError as error:
        raise ActuatorFileError(source, ["must be TOML; its brackets are nested too deeply."]) from error
    except ValueError as error:  # TOMLDecodeError, or a number with too many digits
        raise ActuatorFileError(source, [f"must be TOML; {error}. Correct that place first."]) from error
    version = data.get("schema")
    if isinstance(version, int) and version > SCHEMA_VERSION:
        raise ActuatorFileError(
            source,
            [f"schema is {version}; this femfit reads up to schema {SCHEMA_VERSION}. Update femfit, or write it so."],
        )
    return data


MIN_DISTANCE = 1e-3
"""In mm: a micrometre is less than a face is flat, and still a gap that can be meshed."""


def read_actuator(path: str | Path) -> Actuator:
    """Read an actuator file.

    Raises
    ------
    ActuatorFileError
        If the file cannot be read or has any problem; the error lists all of them.

    Examples
    --------
    >>> import femfit as ff
    >>> actuator = ff.read_actuator("rig.toml")
    >>> actuator.name, actuator.coil.turns
    ('emaws-rig', 308.0)
    """
    path = path_of(path, "An actuator file")
    return actuator_from_toml(read_text(path), str(path), path.parent)


def actuator_from_toml(text: str, source: str = "actuator file", directory: Path | None = None) -> Actuator:
    """Build an actuator from TOML text, as in the files of ``geometry/``.

    Names of further files are relative to ``directory``. ActuatorFileError lists all problems.
    """
    return actuator_from_tables(parse(text, source), source, directory)


def actuator_from_tables(data: dict[str, Any], source: str, directory: Path | None = None) -> Actuator:
    """Build an actuator from a file's tables, whatever its ``[sweep.parameters]`` change."""
    problems: list[str] = []
    design = read_design(data, problems)
    if design is not None:
        data = {**data, "sweep": design.axes(data)}
    header = read_table(FileEntry, data, "", problems)
    _section(ElectromagnetEntry, data, "electromagnet", problems)
    body = _section(MovingEntry, data, "moving", problems)
    winding = _section(CoilEntry, data, "coil", problems)
    hall = _section(HallEntry, data, "hall", problems)
    supply = _section(SupplyEntry, data, "supply", problems)
    solver = _section(SolverEntry, data, "solver", problems)
    reference = _section(ReferenceEntry, data, "reference", problems)
    currents, distances = _axes(data, problems)
    drawing = read_drawing(data, directory or Path(), problems)
    _check_numbers(body, hall, supply, reference, distances, problems)
    coil = _coil(winding, drawing, problems)
    _check_drawing(drawing, read_part(HallPlace, data.get("hall")), distances, problems)
    if problems or header is None or body is None or coil is None or supply is None:
        raise ActuatorFileError(source, problems)
    return Actuator(
        name=header.name,
        description=header.description,
        fixed=tuple(_region(part) for part in drawing.fixed),
        coil=coil,
        moving=MovingPart(tuple(_region(part) for part in drawing.moving), scaled(body.mass_g)),
        supply=Supply(
            supply.voltage_min_V,
            supply.voltage_max_V,
            None if supply.sample_time_ms is None else scaled(supply.sample_time_ms),
        ),
        sweep=SweepAxes(currents, tuple(scaled(d) for d in distances)),
        hall=_hall(hall),
        reference_distances_m=tuple(scaled(d) for d in reference.distance_mm) if reference else (),
        tolerance=solver.tolerance if solver else None,
    )


def _section(entry: type[AnyEntry], data: dict[str, Any], key: str, problems: list[str]) -> AnyEntry | None:
    """A table of the top level; a missing one or one of the wrong type is reported by the top level."""
    return read_table(entry, data[key], key, problems) if isinstance(data.get(key), dict) else None


def _axes(data: dict[str, Any], problems: list[str]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Currents in A and distances in mm; empty where they are unusable."""
    _section(SweepEntry, data, "sweep", problems)
    currents = read_part(CurrentAxis, data.get("sweep"))
    distances = read_part(DistanceAxis, data.get("sweep"))
    return (
        axis_values(currents.current_A, "sweep.current_A", problems) if currents else (),
        axis_values(distances.distance_mm, "sweep.distance_mm", problems) if distances else (),
    )


def _check_numbers(
    body: MovingEntry | None,
    hall: HallEntry | None,
    supply: SupplyEntry | None,
    reference: ReferenceEntry | None,
    distances: Sequence[float],
    problems: list[str],
) -> None:
    if body is not None and not body.regions:
        problems.append("moving.regions must hold a part; it is empty. Give a table [moving.regions.NAME].")
    if supply is not None and supply.voltage_min_V >= supply.voltage_max_V:
        problems.append(
            f"supply.voltage_min_V must be below voltage_max_V; they are {supply.voltage_min_V:g} and "
            f"{supply.voltage_max_V:g}. Exchange or change them."
        )
    if hall is not None:
        _check_hall_output(hall, problems)
    if distances and distances[0] < MIN_DISTANCE:
        problems.append(
            f"sweep.distance_mm must be > 0, the gap from face to face; it starts at {distances[0]:g}. "
            f"Start at {MIN_DISTANCE:g} mm or more."
        )
    if reference is not None and distances:
        outside = [d for d in reference.distance_mm if not distances[0] <= d <= distances[-1]]
        if outside:
            problems.append(
                f"reference.distance_mm must lie within the sweep, {distances[0]:g} to {distances[-1]:g} mm; "
                f"{', '.join(f'{d:g}' for d in outside[:5])} is outside. Change it or widen sweep.distance_mm."
            )


def _check_hall_output(hall: HallEntry, problems: list[str]) -> None:
    if hall.output_min_V >= hall.output_max_V:
        problems.append(
            f"hall.output_min_V must be below output_max_V; they are {hall.output_min_V:g} and "
            f"{hall.output_max_V:g}. Exchange or change them."
        )
    elif not hall.output_min_V <= hall.quiescent_V <= hall.output_max_V:
        problems.append(
            f"hall.quiescent_V must lie between output_min_V and output_max_V; it is {hall.quiescent_V:g} with "
            f"{hall.output_min_V:g} and {hall.output_max_V:g}. Change one of the three."
        )
    if hall.sensitivity_V_per_T == 0:
        problems.append("hall.sensitivity_V_per_T must not be 0; nothing would be seen. Give it, or leave [hall] out.")


def _check_drawing(drawing: Drawing, hall: HallPlace | None, distances: Sequence[float], problems: list[str]) -> None:
    check_thickness([*drawing.standing, *drawing.moving], problems)
    check_overlaps(drawing.standing, problems)
    check_overlaps(drawing.moving, problems)
    if drawing.complete:
        check_zero_heights(drawing.standing, drawing.moving, problems)
        check_moving_body(drawing.moving, problems)
    check_collisions(drawing.standing, drawing.moving, distances, problems)
    if hall is not None:
        check_hall_place(hall, drawing.standing, drawing.moving, distances, problems)


def _coil(entry: CoilEntry | None, drawing: Drawing, problems: list[str]) -> Coil | None:
    if entry is None or drawing.winding is None:
        return None
    polygon = drawing.winding.polygon
    if entry.wire_diameter_mm is not None:
        needed = smallest_winding_area(entry.turns, entry.wire_diameter_mm)
        if needed > polygon.area:
            problems.append(
                f"coil.wire_diameter_mm must let the turns fit; {entry.turns:g} turns of {entry.wire_diameter_mm:g} mm "
                f"need at least {needed:.4g} mm^2 and the winding has {polygon.area:.4g} mm^2. "
                "Take fewer turns, a thinner wire or a larger winding."
            )
    resistance = entry.resistance_ohm
    if resistance is None:
        if entry.wire_diameter_mm is None:
            problems.append(
                "coil.resistance_ohm is missing, and so is wire_diameter_mm to have it from. Give one of the two."
            )
            return None
        resistance = wire_resistance(
            entry.turns, polygon.centroid.x * 1e-3, entry.wire_diameter_mm * 1e-3, entry.temperature_C
        )
    diameter = None if entry.wire_diameter_mm is None else scaled(entry.wire_diameter_mm)
    return Coil(_vertices(polygon), entry.turns, resistance, diameter)


def _hall(entry: HallEntry | None) -> HallElement | None:
    if entry is None:
        return None
    electrical = entry.model_dump(exclude={"r_mm", "z_mm"})
    return HallElement(radius_m=scaled(entry.r_mm), height_m=scaled(entry.z_mm), **electrical)


def _region(part: DrawnPart) -> Region:
    return Region(part.name, _vertices(part.polygon), part.material or AIR)


def _vertices(polygon: Polygon) -> tuple[tuple[float, float], ...]:
    return tuple((scaled(r), scaled(z)) for r, z in polygon.exterior.coords[:-1])
