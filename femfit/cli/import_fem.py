"""``femfit import-fem``: a FEMM model as an actuator file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from femfit.cli.command import OUTPUT, Outcome, Writes, command
from femfit.core.files import DRAWING, write_text


@Parameter(name="*")
@dataclass(frozen=True)
class ImportFemOptions:
    """What moves and where, which the file does not say.

    Attributes
    ----------
    moving_labels : tuple of int
        Place in the file's list, from 1, of a block label in the body that moves; may be repeated; inferred by default.
    mover_side : str
        Side of the fixed parts on which the moving part stands in the file: higher or lower z.
    face_mm : float
        Height z in mm, in the file, of the fixed parts' face from which distances are counted.
    """

    moving_labels: Annotated[tuple[int, ...], Parameter(name="--moving-label")] = ()
    mover_side: Literal["auto", "above", "below"] = "auto"
    face_mm: float | None = None


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
    from femfit.tables.femm.read import import_fem_file

    imported = import_fem_file(model, FemOptions(**vars(options)))
    return Outcome(imported, imported.as_dict(), [(output, lambda path: write_text(path, imported.toml))])
