"""``femfit export``: a model file to something that runs without femfit."""

from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import OUTPUT, Outcome, Writes, command
from femfit.cli.keywords import Keywords
from femfit.core.files import MODEL

_OPTIONS = Keywords("femfit.targets.targets:export", "to filter real sensors")


@command()
def export(
    model: Path,
    *,
    options: Annotated[dict[str, Any], _OPTIONS],
    output: Annotated[Path, OUTPUT, Writes(MODEL, "model.json")],
) -> Outcome:
    """Export a model: filters and simulator in C or in Python alone.

    Parameters
    ----------
    model : Path
        Model file.
    output : Path
        Directory that is absent, empty, or an earlier export.
    """
    return Outcome(ff.export(model, output, **options))
