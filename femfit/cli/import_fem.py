"""``femfit import-fem``: a FEMM model as an actuator file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from femfit.cli.command import OUTPUT, POSITIVE, Outcome, Writes, command
from femfit.core.files import DRAWING, write_text


@Parameter(name="*")
@dataclass(frozen=True)
class ImportFemOptions:
    """What moves, where and how, which the file does not say.

    Attributes
    ----------
    moving_groups : tuple of int
        Group of the blocks that move; may be repeated; inferred by default.
    moving_blocks : tuple of str
        Material name of the blocks that move; may be repeated.
    moving_labels : tuple of int
        Place in the file's list, from 1, of a block label in the body that moves; may be repeated.
    distances_mm : str
        Distances of the sweep in mm beside the file's own, start:stop:step or separated by commas.
    currents_A : str
        Currents of the sweep in A in each circuit beside the file's own, start:stop:step or separated by commas.
    circuits : tuple of str
        Circuit to take; may be repeated; default: those with current.
    mover_side : str
        Side of the fixed parts on which the moving part stands in the file: higher or lower z.
    face_mm : float
        Height z in mm, in the file, of the fixed parts' face from which distances are counted.
    mass_g : float
        Mass of the moving body in g.
    resistance_ohm : float
        Resistance of the winding in ohm, where there is one.
    wire_diameter_mm : float
        Bare copper diameter of the wire in mm.
    arc_degrees : float
        Largest angle in degrees of the chords that stand for arcs where other lines cross them.
    name : str
        Name of the actuator; default: the one from the file's name.
    """

    moving_groups: Annotated[tuple[int, ...], Parameter(name="--moving-group", negative=())] = ()
    moving_blocks: Annotated[tuple[str, ...], Parameter(name="--moving-block", negative=())] = ()
    moving_labels: Annotated[tuple[int, ...], Parameter(name="--moving-label", negative=())] = ()
    distances_mm: Annotated[str | None, Parameter(name="--distance-mm")] = None
    currents_A: Annotated[str | None, Parameter(name="--current-A")] = None
    circuits: Annotated[tuple[str, ...], Parameter(name="--circuit", negative=())] = ()
    mover_side: Literal["auto", "above", "below"] = "auto"
    face_mm: float | None = None
    mass_g: Annotated[float | None, POSITIVE] = None
    resistance_ohm: Annotated[float | None, POSITIVE] = None
    wire_diameter_mm: Annotated[float | None, POSITIVE] = None
    arc_degrees: Annotated[float, Parameter(validator=Number(gte=0.1, lte=30.0))] = 3.0
    name: str | None = None


_DEFAULTS = ImportFemOptions()


@command("File for the findings as JSON.")
def import_fem(
    model: Path,
    *,
    output: Annotated[Path, OUTPUT, Writes(DRAWING)],
    options: ImportFemOptions = _DEFAULTS,
) -> Outcome:
    """Read an axisymmetric magnetic FEMM model (.fem), and write it as an actuator file.

    Parameters
    ----------
    model : Path
        FEMM model (.fem).
    output : Path
        Actuator file (.toml) to write.
    """
    from femfit.tables.femm.model import FemOptions
    from femfit.tables.femm.read import axis_option, import_fem_file

    choices = vars(options) | {
        "distances_mm": axis_option(options.distances_mm, "--distance-mm"),
        "currents_A": axis_option(options.currents_A, "--current-A"),
    }
    imported = import_fem_file(model, FemOptions(**choices))
    return Outcome(imported, imported.as_dict(), [(output, lambda path: write_text(path, imported.toml))])
