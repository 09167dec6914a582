"""Named bounds, among them the paper's literal box (10), and why that one is infeasible.

Eq. (10) of the paper writes the fit with one slack a row, sum_k c_k phi_k(d_j) + s_j = F_j, and bounds every variable,
slacks included, by 0 and 1e-7. So the law would have to lie between F_j - 1e-7 N and F_j in every row.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eq. (10).
"""

import numpy as np
from scipy.optimize import linprog

from femfit.core.arrays import FloatArray
from femfit.core.errors import FitError, InfeasibleFitError
from femfit.fit.law_columns import CoefficientBounds
from femfit.fit.rows import FitRows
from femfit.laws.law import ForceLaw

PAPER_BOUND = 1e-7
"""Upper bound of every variable in eq. (10), in each variable's own SI unit."""

BOUNDS: dict[str, str] = {
    "law": "what the law says: coefficients that must attract are >= 0 at every current",
    "none": "no bounds",
    "paper": "eq. (10) literally: 0..1e-7 on every variable, the slack of each row included",
    "paper-coefficients": "0..1e-7 on the coefficients alone",
}
"""Named bounds and what they do."""


def bounds_by_name(name: str, law: ForceLaw, rows: FitRows) -> CoefficientBounds | None:
    """Bounds on every coefficient of a law.

    Parameters
    ----------
    name : str
        One of :data:`BOUNDS`.
    law : ForceLaw
        Any without shape parameters, for the paper's boxes.
    rows : FitRows
        Of the sweep.

    Returns
    -------
    CoefficientBounds or None
        None for the law's own.

    Raises
    ------
    InfeasibleFitError
        If the literal box excludes every solution, with the first row that shows it.
    """
    count = len(law.basis)
    if name == "law":
        return None
    if name == "none":
        return CoefficientBounds(np.full(count, -np.inf), np.full(count, np.inf))
    if name not in BOUNDS:
        raise FitError(f"Bounds must be one of {', '.join(BOUNDS)}; instead received {name!r}.")
    if law.shape:
        raise FitError(f"The paper's box is written for laws without shape parameters; {law.name} has some.")
    box = CoefficientBounds(np.zeros(count), np.full(count, PAPER_BOUND))
    if name == "paper":
        require_slack_box(law, rows, box)
    return box


def require_slack_box(law: ForceLaw, rows: FitRows, box: CoefficientBounds, slack: float = PAPER_BOUND) -> None:
    """Check that a law reaches every row from below to within a slack, with coefficients in a box.

    Parameters
    ----------
    law : ForceLaw
        Any without shape parameters.
    rows : FitRows
        Of the sweep; each current is checked by itself, as in stage one.
    box : CoefficientBounds
        On the coefficients.
    slack : float
        Largest F_j - law(d_j), N; the smallest is zero.

    Raises
    ------
    InfeasibleFitError
        With the first current and row at which no coefficients are left, and the slack that would be needed.
    """
    for i in rows.currents:
        at = np.flatnonzero(rows.current == i)
        at = at[np.argsort(rows.distance[at])]
        columns, force = law.columns(rows.distance[at], {}), rows.force[at]
        if _needed_slack(columns, force, box) <= slack:
            continue
        first = _first_row(columns, force, box, slack)
        needed = _needed_slack(columns, force, box)
        free = CoefficientBounds(box.lower, np.full(len(box.upper), np.inf))
        needed_free = _needed_slack(columns, force, free)
        names = ", ".join(law.basis)
        row = f"{i:g} A, {1e3 * rows.distance[at[first]]:g} mm, {1e3 * force[first]:.4g} mN"
        limits = f"coefficients of {names} in {box.lower[0]:g}..{box.upper[0]:g}"
        if not np.isfinite(needed):
            raise InfeasibleFitError(
                f"The fit is infeasible, because {limits} and slacks >= 0 leave no solution at row {first + 1} ({row}) "
                "whatever the slacks' upper bound. Bound each coefficient by itself (--bounds law)."
            )
        raise InfeasibleFitError(
            f"The fit is infeasible, because every slack (force minus law in one row) must lie in 0..{slack:g} N: "
            f"with {limits}, rows 1 to {first} at {i:g} A can be met, but not also row {first + 1} ({row}). These "
            f"coefficients need slacks up to {needed:.3g} N, {needed / slack:.2g} times the bound; without "
            f"the coefficients' upper bound still {needed_free:.3g} N. Leave the slacks free and bound each coefficient "
            "by itself: --bounds law, or --bounds paper-coefficients to see which coefficient the box cuts."
        )


def _needed_slack(columns: FloatArray, force: FloatArray, box: CoefficientBounds) -> float:
    """The least upper bound of the slacks that leaves a solution, N; infinite where there is none."""
    scale = np.linalg.norm(columns, axis=0)
    unit = float(np.max(np.abs(force))) or 1.0
    scaled = columns / scale
    ones = np.ones((len(force), 1))
    programme = linprog(
        np.append(np.zeros(columns.shape[1]), 1.0),
        A_ub=np.block([[scaled, 0.0 * ones], [-scaled, -ones]]),
        b_ub=np.concatenate([force, -force]) / unit,
        bounds=[*zip(box.lower * scale / unit, box.upper * scale / unit, strict=True), (0.0, None)],
        method="highs",
    )
    return np.inf if programme.x is None else float(programme.x[-1]) * unit


def _first_row(columns: FloatArray, force: FloatArray, box: CoefficientBounds, slack: float) -> int:
    """Index of the first row that, with those before it, leaves no solution."""
    low, high = 0, len(force)
    while high - low > 1:
        middle = (low + high) // 2
        if _needed_slack(columns[:middle], force[:middle], box) <= slack:
            low = middle
        else:
            high = middle
    return high - 1
