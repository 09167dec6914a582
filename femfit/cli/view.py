"""``femfit view``: an actuator or a point of a sweep as pictures and as a file for ParaView."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from femfit.cli.command import FLAG, NOT_NEGATIVE, OUTPUT, Outcome, Writes, command
from femfit.core.errors import DomainError, RunDirectoryError, UsageError
from femfit.core.files import require_outputs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from femfit.device.drawn_numbers import NumberFacts
    from femfit.device.parts import Actuator
    from femfit.field.tolerance import SolverSettings

Place = tuple[float, float | tuple[float, ...]]
"""Distance in m and current in A, of several circuits one each."""

What = Literal["geometry", "mesh", "flux-lines", "flux-density", "permeability", "vtu"]
FORMATS = (".png", ".svg", ".pdf")
VTU_SUFFIX = ".vtu"


@command("File for the point, its force, and the files written, as JSON.")
def view(
    source: Path,
    *,
    output: Annotated[Path | None, OUTPUT, Writes()] = None,
    distance_mm: float | None = None,
    current_A: Annotated[tuple[float, ...], Parameter(name="--current-A", negative=())] = (),
    row: Annotated[int | None, NOT_NEGATIVE] = None,
    what: Annotated[tuple[What, ...], FLAG] = (),
) -> Outcome:
    """Draw geometry, mesh, flux lines, |B| and permeability at a point, and write the field for ParaView.

    The geometry marks the numbers of the drawing and lists what they are: faces, bores, corners.

    Parameters
    ----------
    source : Path
        Actuator file (.toml), or the run directory of a sweep.
    output : Path
        Directory for everything, or one file: .png, .svg or .pdf (|B| with flux lines unless --what says otherwise),
        .vtu (the field for ParaView); NAME-view by default.
    distance_mm : float
        Distance in mm within the sweep; the middle one by default.
    current_A : tuple of float
        Current in A, once for each circuit; the sweep's largest by default.
    row : int
        Row of the sweep's table in place of distance and current, counted from 0.
    what : tuple of str
        Picture to draw; may be repeated; all by default.
    """
    from femfit.cli.output import status
    from femfit.device.drawn_numbers import in_picture
    from femfit.device.load import read_actuator
    from femfit.report.field_cells import solve_point
    from femfit.report.field_figures import point_title, write_views
    from femfit.tables.signatures import read_signatures

    if row is not None and (not source.is_dir() or distance_mm is not None or current_A):
        raise UsageError(
            "--row counts the rows of a sweep's table: give a run directory with it, and neither --distance-mm nor "
            "--current-A."
        )
    settings: SolverSettings | None = None
    place: Place | None = None
    if source.is_dir():
        actuator, settings, place = _swept(source, row)
        signatures = read_signatures(source)
        numbers = () if signatures is None else in_picture(signatures.numbers)
    else:
        actuator = read_actuator(source)
        numbers = _numbers(source)
    distance, current = place or _within(actuator, distance_mm, current_A)
    files = _files(output or Path(f"{Path(actuator.name).name}-view"), what)
    require_outputs([source], *((path, None) for _, path in files))
    with status(f"solve {actuator.name}") as say:
        point = solve_point(actuator, distance, current, settings)
        say("draw")
        sample = write_views(point, files, numbers)
    lines = [f"{actuator.name}: {point_title(sample)}"]
    if numbers and "geometry" in dict(files):
        lines.append("Numbers of the drawing, as the picture marks them:")
        lines += [f"  {k}  {number.title} [{number.key}]" for k, number in enumerate(numbers, 1)]
    lines += [f"written: {path}" for _, path in files]
    data = {
        "name": actuator.name,
        "distance_m": distance,
        "current_A": current,
        "force_N": sample.force_N,
        "part_flux_density_T": sample.part_flux_density_T,
        "unknowns": sample.unknowns,
        "numbers": [{"key": number.key, "title": number.title, "at_mm": number.at} for number in numbers],
        "files": {kind: str(path) for kind, path in files},
    }
    return Outcome("\n".join(lines), data)


def _numbers(drawing: Path) -> "tuple[NumberFacts, ...]":
    """Of a drawing that sweeps no parameters, whose numbers are one each."""
    from femfit.core.errors import ActuatorFileError
    from femfit.device.drawn_numbers import in_picture, read_numbers

    try:
        return in_picture(number.facts for number in read_numbers(drawing))
    except ActuatorFileError:
        return ()


def _swept(directory: Path, row: int | None) -> "tuple[Actuator, SolverSettings, Place | None]":
    """The actuator and settings of a sweep, and the point of a row of its table."""
    from femfit.core.sweep_columns import VARIANT, current_columns
    from femfit.device.summary import actuator_from_record
    from femfit.field.tolerance import SolverSettings
    from femfit.tables.sweep_table import read_sweep_table

    table = read_sweep_table(directory)
    if "inputs" not in table.manifest:
        raise RunDirectoryError(
            f"{directory} does not say which drawing was swept: its manifest.json has no inputs. Give the actuator "
            "file with --distance-mm and --current-A, or sweep again."
        )
    inputs, settings = table.manifest["inputs"], SolverSettings(**table.manifest["settings"])
    if row is None:
        return actuator_from_record(inputs, str(directory)), settings, None
    if row >= len(table.rows):
        last = len(table.rows) - 1
        raise DomainError(f"--row must be at most {last}, the last row of {directory}; instead received {row}.")
    chosen = table.rows.iloc[row]
    if VARIANT in chosen:
        inputs = table.manifest["variants"][int(chosen[VARIANT]) - 1]["inputs"]
        if inputs is None:
            raise DomainError(f"Row {row} has no drawing: {chosen['status']}.")
    actuator = actuator_from_record(inputs, str(directory))
    currents = [float(chosen[name]) for name in current_columns([circuit.name for circuit in actuator.circuits])]
    return actuator, settings, (float(chosen["distance_m"]), _current(currents))


def _current(currents: "Sequence[float]") -> float | tuple[float, ...]:
    """One number where there is one circuit, or none."""
    return currents[0] if len(currents) == 1 else tuple(currents)


def _within(actuator: "Actuator", distance_mm: float | None, currents: tuple[float, ...]) -> Place:
    """Distance in m, within the sweep, and currents in A."""
    axes = actuator.sweep
    low, high = min(axes.distances_m), max(axes.distances_m)
    distance = axes.distances_m[len(axes.distances_m) // 2] if distance_mm is None else 1e-3 * distance_mm
    slack = 1e-9 * high  # of the conversion from mm
    if not low - slack <= distance <= high + slack:
        raise DomainError(
            f"--distance-mm must be within the sweep, {1e3 * low:g} to {1e3 * high:g} mm, where no parts collide; "
            f"instead received {1e3 * distance:g}. Widen [sweep] in the actuator file."
        )
    each = (axes.currents_A, *axes.further_A)
    if currents and len(currents) != len(each):
        names = ", ".join(circuit.name for circuit in actuator.circuits)
        raise UsageError(
            f"--current-A must be given once for each circuit ({names}); instead received it {len(currents)} times."
        )
    return distance, _current(currents or [max(axis) for axis in each])


def _files(output: Path, what: tuple[str, ...]) -> list[tuple[str, Path]]:
    """What to write where."""
    from femfit.report.field_figures import PICTURES, VTU

    suffix = output.suffix.lower()
    if suffix and suffix not in (*FORMATS, VTU_SUFFIX) and not output.is_dir():
        raise UsageError(
            f"--output must be a directory, a picture ({', '.join(FORMATS)}) or the field ({VTU_SUFFIX}); instead "
            f"received {output.name}."
        )
    if suffix not in (*FORMATS, VTU_SUFFIX):
        return [
            (kind, output / ("field.vtu" if kind == VTU else f"{kind}.png"))
            for kind in dict.fromkeys(what or (*PICTURES, VTU))
        ]
    kinds = what or ((VTU,) if suffix == VTU_SUFFIX else ("flux-density",))
    if len(kinds) > 1 or (kinds[0] == VTU) != (suffix == VTU_SUFFIX):
        raise UsageError(
            f"{output} can hold one picture (.png, .svg, .pdf) or the field (.vtu), not {' and '.join(kinds)}. Give a "
            "directory as --output for several."
        )
    return [(kinds[0], output)]
