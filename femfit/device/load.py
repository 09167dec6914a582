"""Read an actuator file, every problem at once: its record in SI units, that of a manifest, and starting drawings."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from femfit.core.errors import ActuatorFileError, TableError
from femfit.core.files import path_of
from femfit.core.results import json_ready
from femfit.device.complaints import DrawnTables, MistakeError, Reading, in_file, read_table, read_tables, translated
from femfit.device.drawing import DrawnPart, check_parts, read_parts
from femfit.device.keys import converted, scaled
from femfit.device.parameters import read_design
from femfit.device.parts import AIR, Actuator, MovingPart, Region, SweepAxes, is_iron
from femfit.device.read_device import circuit_names, read_axes, read_circuits, read_mechanics, read_sensors
from femfit.device.schema import NAME_PATTERN, SCHEMA_VERSION, FileEntry, SolverEntry
from femfit.device.thermal import STILL_AIR
from femfit.device.tolerances import read_tolerances


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


def parse(text: str, source: str) -> DrawnTables:
    """The tables of TOML text, by today's names."""
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOMLDecodeError, or a number with too many digits
        nested = isinstance(error, RecursionError)
        reason = "its brackets are nested too deeply" if nested else f"{error}. Correct that place first"
        raise ActuatorFileError(source, [f"must be TOML; {reason}."]) from error
    version = data.get("schema")
    if isinstance(version, int) and version > SCHEMA_VERSION:
        raise ActuatorFileError(source, [str(MistakeError("later_schema", version=version, most=SCHEMA_VERSION))])
    return translated(data)


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
    data, problems = translated(data), list[str]()
    read_design(data, problems)
    header: FileEntry | None = read_table(FileEntry, data, "", problems)
    problems += data.problems
    file = Reading(data, problems, entries := read_tables(data, problems))
    solver: SolverEntry = entries.get("solver", SolverEntry())
    reference_m = entries["reference"].distance_m if "reference" in entries else ()
    parts = read_parts(file, directory or Path())
    circuits, coils = read_circuits(file, parts)
    names = circuit_names(file)
    mechanics = read_mechanics(file)
    sensors = tuple(read_sensors(file, names))
    currents_A, distances = read_axes(file, names)
    first_A, *further_A = currents_A or [(0.0,)]
    bias_A = solver.eddy_bias_A
    eddy_bias_A = bias_A if isinstance(bias_A, tuple) else () if bias_A is None else (bias_A,)
    if bias_A is not None and len(eddy_bias_A) != len(names):
        file.complain("eddy_bias", circuits=len(names), count=len(eddy_bias_A))
    steps = [scaled(distance, 3) for distance in reference_m]
    outside = [f"{d:g}" for d in steps if distances and not distances[0] <= d <= distances[-1]]
    if outside:
        file.complain("reference", first=distances[0], last=distances[-1], outside=", ".join(outside[:5]))
    read_tolerances(data, problems)
    reached = [distance for distance in distances if distance > 0.0] if data.is_schema_1 else distances
    check_parts(file, parts, reached)
    if problems or header is None or mechanics is None:
        raise ActuatorFileError(source, [in_file(data, problem) for problem in problems])
    return Actuator(
        name=header.name,
        description=header.description,
        fixed=_regions(parts, moves=False),
        coils=coils,
        moving=MovingPart(_regions(parts, moves=True)),
        mechanics=mechanics,
        sweep=SweepAxes(first_A, converted(distances, -3), tuple(further_A)),
        circuits=circuits,
        sample_time_s=entries["supply"].sample_time_s if "supply" in entries else None,
        sensors=sensors,
        reference_distances_m=reference_m,
        tolerance=solver.tolerance,
        frequencies_Hz=solver.frequency_Hz or (),
        eddy_error=solver.eddy_error,
        thermal=entries.get("thermal", STILL_AIR),
        eddy_bias_A=eddy_bias_A,
    )


def _regions(parts: Sequence[DrawnPart], *, moves: bool) -> tuple[Region, ...]:
    return tuple(
        Region(body.place[-1], converted(body.outline.corners, -3), body.material or AIR, body.outline.bulges)
        for body in parts
        if body.moves == moves and not body.winding
    )


def starter_text(name: str, title: str | None = None) -> str:
    """The actuator file of a drawing, under a name of its own where one is given that is fit for a name."""
    text = files("femfit.device").joinpath(f"examples/{name}.toml").read_text(encoding="utf-8")
    return text if not re.match(NAME_PATTERN, title or "") else text.replace(f'name = "{name}"', f'name = "{title}"', 1)


def sweep_manifest_entry(actuator: Actuator) -> dict[str, Any]:
    """The manifest's ``actuator`` entry: circuits, motion, sensors, and what kind of actuator it is."""
    record, supplied, kind = json_ready(actuator), {}, {}
    names = "name", "description", "sample_time_s", "reference_distances_m", "circuits", "mechanics", "sensors"
    if len(actuator.circuits) == 1 and actuator.supplies_V:  # as measured tables without a drawing have it, too
        limits = "resistance_ohm", "voltage_min_V", "voltage_max_V"
        supplied = {name: getattr(actuator.circuits[0], name) for name in limits}
    for body, regions in (("fixed", actuator.fixed), ("moving", actuator.moving.regions)):
        kind[f"{body}_magnet"] = any(region.material.remanence_T for region in regions)
        kind[f"{body}_iron"] = any(is_iron(region.material) for region in regions)
    return {
        **{name: record[name] for name in names},
        "mass_kg": actuator.mechanics.mass_kg,
        **supplied,
        "hall": json_ready(actuator.hall),
        "coils": [{"name": coil.name, "turns": coil.turns, "moves": coil.moves} for coil in actuator.coils],
        "kind": {**kind, "coil": bool(actuator.coils), "saturates": actuator.saturates},
    }


def actuator_from_record(record: Mapping[str, Any], source: str) -> Actuator:
    """Build the actuator again that ``dataclasses.asdict`` made a record of."""
    try:
        circuits = [circuit_record(each) for each in record.get("circuits") or () if isinstance(each, Mapping)]
        actuator = TypeAdapter(Actuator).validate_python({**record, "circuits": circuits})
    except ValidationError as error:
        problems = [f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}." for fault in error.errors()]
        raise ActuatorFileError(source, [*problems, "Sweep again, or give the actuator file."]) from error
    if re.fullmatch(NAME_PATTERN, actuator.name) is None:  # directories are named after it
        received = f"instead received {actuator.name[:64]!r}. Sweep again."
        raise ActuatorFileError(
            source, [f"name: must begin with a letter and hold letters, digits, - and _; {received}"]
        )
    return actuator


def circuit_record(record: Mapping[str, Any]) -> dict[str, Any]:
    """A circuit's record without what is null, as a voltage's open limits; TableError for one of an earlier version."""
    if "coils" in record or "minimum" in (record.get("drive") or {}):
        raise TableError("The manifest's circuits are of an earlier version. Sweep again, or give the actuator file.")
    return {key: value for key, value in record.items() if value is not None}
