"""The actuator file: ``femfit new`` begins one, ``import-fem`` makes one, ``view`` draws it, ``heat`` warms it."""

import json
import math
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import femfit as ff
from femfit.cli.command import OUTPUT, Outcome, Writes, command
from femfit.cli.keywords import Keywords
from femfit.cli.output import status
from femfit.core.errors import ActuatorFileError, DomainError, OutputError, UsageError
from femfit.core.files import DRAWING, PICTURE, require_outputs, write_text

if TYPE_CHECKING:
    from femfit.device.drawn_numbers import NumberFacts

Kind = Literal["ball", "bearing", "levitation", "magnet-pair", "pot-magnet", "relay", "solenoid", "voice-coil"]
What = Literal["geometry", "mesh", "flux-lines", "flux-density", "vtu"]

_HELD = Keywords("find_temperatures", "current_A voltage_V=voltage distance_m=distance-mm")
_MOVER = Keywords("femfit.tables.femm.model:FemOptions", "moving_labels=moving-label mover_side face_mm")

_FIELD = ".vtu"


def new(kind: Kind | None = None, *, schema: bool = False, output: Annotated[Path | None, OUTPUT] = None) -> None:
    """Write a commented drawing to start from: a solenoid, a voice coil, a bearing ...

    Parameters
    ----------
    kind : str
        Kind of actuator that is nearest to yours.
    schema : bool
        JSON Schema of actuator files instead, by which an editor completes keys and says what each wants.
    output : Path
        File to write, which must not be there yet; KIND.toml or actuator-schema.json by default.
    """
    from femfit.device.load import starter_text
    from femfit.device.schema import json_schema

    if (kind is None) != schema:
        raise UsageError("Give a kind of actuator, such as solenoid, or --schema alone.")
    path = output or Path(f"{kind}.toml" if kind else "actuator-schema.json")
    if path.suffix != (end := ".toml" if kind else ".json"):
        raise OutputError(f"The file must end in {end}; instead received {path}. Give for example -o mine{end}.")
    if path.exists():
        raise OutputError(f"{path} is there already. Give another name with -o, or remove it.")
    write_text(path, starter_text(kind, path.stem) if kind else json.dumps(json_schema(), indent=1))
    print(f"written: {path}")
    if kind:
        print(f"See it:  femfit view {path} -o {path.stem}.png\nRun it:  femfit run {path}")


@command("File for the findings as JSON.")
def import_fem(
    model: Path, *, output: Annotated[Path, OUTPUT, Writes(DRAWING)], options: Annotated[dict[str, Any], _MOVER]
) -> Outcome:
    """Read a FEMM model (.fem) as an actuator file.

    Parameters
    ----------
    model : Path
        FEMM model (.fem).
    output : Path
        Actuator file (.toml) to write.
    """
    from femfit.tables.femm.model import FemOptions
    from femfit.tables.femm.read import import_fem_file

    imported = import_fem_file(model, FemOptions(**options))
    return Outcome(imported, files=[(output, partial(write_text, text=imported.toml))])


@command("File for the result as JSON, with the thermal network.")
def heat(actuator: Path, *, options: Annotated[dict[str, Any], _HELD]) -> Outcome:
    """How warm winding and magnet become, and which current may last.

    Parameters
    ----------
    actuator : Path
        Actuator file (.toml), whose table [thermal] says what surrounds the actuator.
    """
    return Outcome(ff.find_temperatures(actuator, **options))


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
    from femfit.device.drawn_numbers import in_picture, read_numbers
    from femfit.report.field_figures import point_title, write_view
    from femfit.report.field_sample import solve_point

    actuator = ff.read_actuator(source)
    numbers: tuple[NumberFacts, ...] = ()
    with suppress(ActuatorFileError):  # of a drawing that sweeps parameters a number is not one value
        numbers = in_picture(number.facts for number in read_numbers(source))
    distance, current = _within(actuator, distance_mm, current_A)
    files = _files(output or Path(f"{Path(actuator.name).name}-view"), what)
    require_outputs([source], *((path, None) for path in files.values()))
    with status(f"solve {actuator.name}"):
        point = solve_point(actuator, distance, current)
        sample = point.sample
    lines = [f"{actuator.name}: {point_title(sample)}"]
    if numbers and "geometry" in files:
        lines += ["Numbers of the drawing:", *(f"  {number.title} [{number.key}]" for number in numbers)]
    data = {
        "name": actuator.name,
        "distance_m": distance,
        "current_A": current,
        "force_N": sample.force_N,
        "part_flux_density_T": sample.part_flux_density_T,
        "unknowns": sample.unknowns,
        "numbers": [{"key": number.key, "title": number.title, "at_mm": number.at} for number in numbers],
        "files": {kind: str(path) for kind, path in files.items()},
    }
    return Outcome("\n".join(lines), data, [(path, partial(write_view, kind, point)) for kind, path in files.items()])


def _within(
    actuator: ff.Actuator, distance_mm: float | None, currents: tuple[float, ...]
) -> tuple[float, float | tuple[float, ...]]:
    """Distance in m, within the sweep, and current in A, of several circuits one each."""
    from femfit.report.field_figures import middle_point

    axes = actuator.sweep
    low, high = min(axes.distances_m), max(axes.distances_m)
    distance, current = middle_point(actuator)
    if distance_mm is not None:
        distance = 1e-3 * distance_mm
    slack = 1e-9 * high  # of the conversion from mm
    if not low - slack <= distance <= high + slack:
        raise DomainError(
            f"--distance-mm must be within the sweep, {1e3 * low:g} to {1e3 * high:g} mm, where no parts collide; "
            f"instead received {1e3 * distance:g}. Widen [sweep] in the actuator file."
        )
    if not all(map(math.isfinite, currents)):
        raise UsageError(f"--current-A must be finite; instead received {', '.join(f'{i:g}' for i in currents)}.")
    if currents and len(currents) != 1 + len(axes.further_A):
        names = ", ".join(circuit.name for circuit in actuator.circuits)
        raise UsageError(
            f"--current-A must be given once for each circuit ({names}); instead received it {len(currents)} times."
        )
    return distance, (currents if axes.further_A else currents[0]) if currents else current


def _files(output: Path, what: tuple[str, ...]) -> dict[str, Path]:
    """Where each picture is written, and the field."""
    from femfit.report.field_figures import PICTURES, VTU

    suffix = output.suffix.lower()
    if not suffix or output.is_dir():
        return {kind: output / ("field.vtu" if kind == VTU else f"{kind}.png") for kind in what or (*PICTURES, VTU)}
    kind, *more = what or ((VTU,) if suffix == _FIELD else ("flux-density",))
    if more or suffix not in ((_FIELD,) if kind == VTU else PICTURE.suffixes):
        raise UsageError(
            f"--output must be a directory, or a file of one picture ({', '.join(PICTURE.suffixes)}) or of the field "
            f"({_FIELD}) for --what {kind}; instead received {output.name}. Give a directory for several."
        )
    return {kind: output}
