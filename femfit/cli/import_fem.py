"""``femfit import-fem``: a FEMM model as an actuator file."""

from pathlib import Path
from typing import Annotated, Any

from femfit.cli.command import OUTPUT, Outcome, Writes, command
from femfit.cli.keywords import Keywords
from femfit.core.files import DRAWING, write_text

_OPTIONS = Keywords("femfit.tables.femm.model:FemOptions", "moving_labels=moving-label mover_side face_mm")


@command("File for the findings as JSON.")
def import_fem(
    model: Path,
    *,
    output: Annotated[Path, OUTPUT, Writes(DRAWING)],
    options: Annotated[dict[str, Any], _OPTIONS],
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
    return Outcome(imported, imported.as_dict(), [(output, lambda path: write_text(path, imported.toml))])
