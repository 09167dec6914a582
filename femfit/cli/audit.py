"""``femfit audit``: a model checked as its file holds it."""

from pathlib import Path


def audit(model: Path, *, table: Path | None = None, json: Path | None = None) -> None:
    """Check a model file: misfit to its table, circuit, signs, bounds, range, sensor, precision.

    Parameters
    ----------
    model : Path
        Model file (.json).
    table : Path
        Sweep table that the model was fitted to, or its directory; default: the one beside the model.
    json : Path
        File for the findings as JSON.

    The exit code is 1 where something is wrong, 0 where it holds or is only worth a look.
    """
    from femfit.audit.audit_model import audit_model
    from femfit.cli.output import write_json
    from femfit.core.files import RESULT, require_outputs

    require_outputs([model, table], (json, RESULT))
    result = audit_model(model, table)
    write_json(json, {"file": model.name, **result.to_dict()})
    print(result)
    if result.count("wrong"):
        raise SystemExit(1)
