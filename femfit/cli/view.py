"""``femfit view``: an actuator or a point of a sweep as pictures and as a file for ParaView."""

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import femfit as ff
from femfit.cli.command import OUTPUT, Outcome, Writes, command
from femfit.core.errors import ActuatorFileError, DomainError, UsageError
from femfit.core.files import require_outputs

if TYPE_CHECKING:
    from femfit.device.drawn_numbers import NumberFacts

What = Literal["geometry", "mesh", "flux-lines", "flux-density", "vtu"]
FORMATS = (".png", ".svg", ".pdf")
VTU_SUFFIX = ".vtu"


@command("File for the point, its force, and the files written, as JSON.")
def view(
    source: Path,
    *,
    output: Annotated[Path | None, OUTPUT, Writes()] = None,
    distance_mm: float | None = None,
    current_A: tuple[float, ...] = (),
    what: tuple[What, ...] = (),
) -> Outcome:
    """Draw geometry, mesh, flux lines and |B|; write a .vtu file.

    With the geometry the numbers of the drawing are listed: faces, bores, corners.

    Parameters
    ----------
    source : Path
        Actuator file (.toml).
    output : Path
        Directory for everything, or one file: .png, .svg or .pdf (|B| with flux lines unless --what says otherwise),
        .vtu (the field for ParaView); NAME-view by default.
    distance_mm : float
        Distance in mm within the sweep; the middle one by default.
    current_A : tuple of float
        Current in A, once for each circuit; the sweep's largest by default.
    what : tuple of str
        Picture to draw; may be repeated; all by default.
    """
    from femfit.cli.output import status
    from femfit.device.drawn_numbers import in_picture, read_numbers
    from femfit.report.field_figures import point_title, write_views
    from femfit.report.field_sample import solve_point

    actuator = ff.read_actuator(source)
    numbers: tuple[NumberFacts, ...] = ()
    with suppress(ActuatorFileError):  # of a drawing that sweeps parameters a number is not one value
        numbers = in_picture(number.facts for number in read_numbers(source))
    distance, current = _within(actuator, distance_mm, current_A)
    files = _files(output or Path(f"{Path(actuator.name).name}-view"), what)
    require_outputs([source], *((path, None) for _, path in files))
    with status(f"solve {actuator.name}") as say:
        point = solve_point(actuator, distance, current)
        say("draw")
        sample = write_views(point, files)
    lines = [f"{actuator.name}: {point_title(sample)}"]
    if numbers and "geometry" in dict(files):
        lines.append("Numbers of the drawing:")
        lines += [f"  {number.title} [{number.key}]" for number in numbers]
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


def _within(
    actuator: ff.Actuator, distance_mm: float | None, currents: tuple[float, ...]
) -> tuple[float, float | tuple[float, ...]]:
    """Distance in m, within the sweep, and current in A, of several circuits one each."""
    from femfit.report.field_figures import middle_point

    axes = actuator.sweep
    low, high = min(axes.distances_m), max(axes.distances_m)
    middle, largest = middle_point(actuator)
    distance = middle if distance_mm is None else 1e-3 * distance_mm
    slack = 1e-9 * high  # of the conversion from mm
    if not low - slack <= distance <= high + slack:
        raise DomainError(
            f"--distance-mm must be within the sweep, {1e3 * low:g} to {1e3 * high:g} mm, where no parts collide; "
            f"instead received {1e3 * distance:g}. Widen [sweep] in the actuator file."
        )
    if currents and len(currents) != 1 + len(axes.further_A):
        names = ", ".join(circuit.name for circuit in actuator.circuits)
        raise UsageError(
            f"--current-A must be given once for each circuit ({names}); instead received it {len(currents)} times."
        )
    return distance, (currents if axes.further_A else currents[0]) if currents else largest


def _files(output: Path, what: tuple[str, ...]) -> list[tuple[str, Path]]:
    """What to write where."""
    from femfit.report.field_figures import PICTURES, VTU

    suffix = output.suffix.lower()
    if not suffix or output.is_dir():
        kinds = dict.fromkeys(what or (*PICTURES, VTU))
        return [(kind, output / ("field.vtu" if kind == VTU else f"{kind}.png")) for kind in kinds]
    kind, *more = what or ((VTU,) if suffix == VTU_SUFFIX else ("flux-density",))
    if more or suffix not in ((VTU_SUFFIX,) if kind == VTU else FORMATS):
        raise UsageError(
            f"--output must be a directory, or a file of one picture ({', '.join(FORMATS)}) or of the field "
            f"({VTU_SUFFIX}) for --what {kind}; instead received {output.name}. Give a directory for several."
        )
    return [(kind, output)]
