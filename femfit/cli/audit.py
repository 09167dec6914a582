"""``femfit audit`` and ``femfit tolerance``: a model checked as its file holds it, and a series of devices."""

from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import Outcome, command
from femfit.cli.keywords import Keywords

_OPTIONS = Keywords("femfit.audit.tolerance_analysis:analyse_tolerances", "currents_A=current-A quantity=of")


@command("File for the findings as JSON.")
def audit(model: Path, *, table: Path | None = None) -> Outcome:
    """Check a model against its table, physics and supply; exits with 1 if wrong.

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


@command()
def tolerance(sweep: Path, *, distance_mm: float, options: Annotated[dict[str, Any], _OPTIONS]) -> Outcome:
    """How a series of devices scatters by the drawing's tolerances.

    Parameters
    ----------
    sweep : Path
        Directory of a sweep with --signatures.
    distance_mm : float
        Distance in mm, of which the nearest swept point is taken.
    """
    return Outcome(ff.analyse_tolerances(sweep, distance_m=1e-3 * distance_mm, **options))
