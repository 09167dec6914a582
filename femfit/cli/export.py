"""``femfit export``: a model file to something that runs without femfit."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def export(
    model: Path,
    *,
    to: str = "estimator",
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    json: Path | None = None,
) -> None:
    """Export a model.

    Parameters
    ----------
    model : Path
        Model file.
    to : str
        Kind of export: estimator (filters and simulator as a package that needs numpy alone).
    output : Path
        Directory that is absent, empty, or an earlier export.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import write_json
    from femfit.core.files import MODEL, RESULT, require_outputs
    from femfit.targets import targets

    require_outputs([model], (output / "model.json", MODEL), (json, RESULT))
    exported = targets.export(model, output, to=to)
    print(exported)
    write_json(json, exported.to_dict())
