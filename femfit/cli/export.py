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
        Directory; absent, empty, or an earlier export.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import write_json
    from femfit.core.outputs import MODEL, RESULT, require_outputs
    from femfit.model.json_file import read_model
    from femfit.targets.targets import export_target

    require_outputs([model], (output / "model.json", MODEL), (json, RESULT))
    target = export_target(to)
    files = target.export(read_model(model), output)
    print(f"{output}: {target.name} of {model}, {len(files)} files; try python {output / 'example.py'}")
    names = [str(file.relative_to(output)) for file in files]
    write_json(json, {"target": target.name, "directory": str(output), "files": names})
