"""``femfit tolerance``: what a drawing's tolerances make of a series of devices."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from femfit.cli.command import Outcome, command


@command()
def tolerance(
    sweep: Path,
    *,
    distance_mm: float,
    current_A: Annotated[tuple[float, ...], Parameter(name="--current-A", negative=())] = (),
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
        Quantity: force_N, flux_linkage_Wb, hall_T, or force_constant_N_per_A (the force's slope over the current).
    """
    from femfit.audit.tolerance_analysis import analyse_tolerances

    return Outcome(analyse_tolerances(sweep, distance_m=1e-3 * distance_mm, currents_A=current_A, quantity=of))
