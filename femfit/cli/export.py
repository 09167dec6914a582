"""``femfit export``: a model file to something that runs without femfit."""

from pathlib import Path
from typing import Annotated

from femfit.cli.command import OUTPUT, Outcome, Writes, command
from femfit.core.files import MODEL


@command()
def export(
    model: Path,
    *,
    to: str = "estimator",
    output: Annotated[Path, OUTPUT, Writes(MODEL, "model.json")],
) -> Outcome:
    """Export a model.

    Parameters
    ----------
    model : Path
        Model file.
    to : str
        Kind of export: estimator (filters and simulator as a package that needs numpy alone).
    output : Path
        Directory that is absent, empty, or an earlier export.
    """
    from femfit.targets import targets

    return Outcome(targets.export(model, output, to=to))
