"""``femfit audit``: a model checked as its file holds it."""

from pathlib import Path

from femfit.cli.command import Outcome, command


@command("File for the findings as JSON.")
def audit(model: Path, *, table: Path | None = None) -> Outcome:
    """Check a model file: misfit to its table, circuit, signs, bounds, range, sensor, precision.

    Parameters
    ----------
    model : Path
        Model file (.json).
    table : Path
        Sweep table that the model was fitted to, or its directory; default: the one beside the model.

    The exit code is 1 where something is wrong, 0 where it holds or is only worth a look.
    """
    from femfit.audit.audit_model import audit_model

    result = audit_model(model, table)
    wrong = SystemExit(1) if result.count("wrong") else None
    return Outcome(result, {"file": model.name, **result.to_dict()}, error=wrong)
