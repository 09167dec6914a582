"""``femfit audit`` and ``femfit tolerance``: a model checked as its file holds it, and a series of devices."""

from pathlib import Path

import femfit as ff
from femfit.cli.command import Outcome, command


@command("File for the findings as JSON.")
def audit(model: Path, *, table: Path | None = None) -> Outcome:
    """Check a model file: misfit to its table, signs, bounds, range, sensor, precision.

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
def tolerance(
    sweep: Path,
    *,
    distance_mm: float,
    current_A: tuple[float, ...] = (),
    of: str = "force_N",
) -> Outcome:
    """How a series of devices scatters by the drawing's tolerances, and which number to hold more tightly.

    Parameters
    ----------
    sweep : Path
        Directory of a sweep with --signatures.
    distance_mm : float
        Distance in mm, of which the nearest swept point is taken.
    current_A : tuple of float
        Current in A, once for each circuit whose current was swept.
    of : str
        Quantity: force_N, flux_linkage_Wb or hall_T.
    """
    return Outcome(ff.analyse_tolerances(sweep, distance_m=1e-3 * distance_mm, currents_A=current_A, quantity=of))
