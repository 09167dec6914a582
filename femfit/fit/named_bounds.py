"""Named bounds, among them the paper's literal box (10), and why that one is infeasible.

Eq. (10) of the paper writes the fit with one slack a row, sum_k c_k phi_k(d_j) + s_j = F_j, and bounds every variable,
slacks included, by 0 and 1e-7. So the law would have to lie between F_j - 1e-7 N and F_j in every row.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eq. (10).
"""

from collections.abc import Mapping

import numpy as np
from scipy.optimize import linprog

from femfit.core.arrays import FloatArray
from femfit.core.errors import FitError, InfeasibleFitError
from femfit.fit.bounded_qp import active_set_least_squares
from femfit.fit.law_columns import CoefficientBounds
from femfit.fit.law_fit import default_bounds
from femfit.fit.rows import FitRows
from femfit.laws.law import ForceLaw

PAPER_BOUND = 1e-7
"""Upper bound of every variable in eq. (10), in each variable's own SI unit."""

BOUNDS: dict[str, str] = {
    "law": "what the law says: coefficients that must attract are >= 0 at every current >= 0",
    "none": "no bounds",
    "paper": "eq. (10) literally: 0..1e-7 on every variable, the slack of each row included",
    "paper-coefficients": "0..1e-7 on the coefficients alone",
}
"""Named bounds and what they do."""


def bounds_by_name(
    name: str, law: ForceLaw, rows: FitRows, single: Mapping[str, tuple[float, float]] | None = None
) -> CoefficientBounds:
    """Bounds on every coefficient of a law.

    Parameters
    ----------
    law : ForceLaw
        Any without shape parameters, for the paper's boxes.
    single : mapping of str to (float, float), or None
        Bounds of single columns' coefficients, over the named ones.

    Raises
    ------
    InfeasibleFitError
        If the literal box excludes every solution, with the first row that shows it.
    """
    count = len(law.basis)
    infinite = np.full(count, np.inf)
    if name not in BOUNDS:
        raise FitError(f"Bounds must be one of {', '.join(BOUNDS)}; instead received {name!r}.")
    if name == "law":
        box = default_bounds(law)
    elif name == "none":
        box = CoefficientBounds(-infinite, infinite)
    elif law.shape:
        raise FitError(f"The paper's box is written for laws without shape parameters; {law.name} has some.")
    else:
        box = CoefficientBounds(np.zeros(count), np.full(count, PAPER_BOUND))
    lower, upper = box.lower.copy(), box.upper.copy()
    for basis, ends in (single or {}).items():
        if basis not in law.basis:
            raise FitError(f"Law {law.name} has the coefficients of {', '.join(law.basis)}; none of {basis!r}.")
        lower[law.basis.index(basis)], upper[law.basis.index(basis)] = ends
    attracting = None
    if box.attracting is not None:  # bounds given by hand hold at every current
        attracting = box.attracting & ~np.isin(law.basis, list(single or {}))
    box = CoefficientBounds(lower, upper, attracting)
    if name == "paper":
        require_slack_box(law, rows, box)
    return box


def require_slack_box(law: ForceLaw, rows: FitRows, box: CoefficientBounds, slack: float = PAPER_BOUND) -> None:
    """Check that a law reaches every row from below to within a slack, with coefficients in a box.

    Parameters
    ----------
    rows : FitRows
        Of the sweep; each current is checked by itself, as in stage one.
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
        needed = _needed_slack(columns, force, box)
        if needed > slack:
            first = _first_row(columns, force, box, slack)
            free = CoefficientBounds(box.lower, np.full(len(box.upper), np.inf))
            raise InfeasibleFitError(
                f"The fit is infeasible, because eq. (10) bounds every slack (force minus law in one row) by "
                f"0..{slack:g} N. At {i:g} A, {_rows_up_to(first)} can be met, but not also row {first + 1} "
                f"({1e3 * rows.distance[at[first]]:g} mm, {1e3 * force[first]:.4g} mN): the slacks would have to reach "
                f"{needed:.3g} N, {needed / slack:.2g} times their bound, and without upper bounds on the coefficients "
                f"still {_needed_slack(columns, force, free):.3g} N. {_excluded(law, rows, box)}"
                "Bound each coefficient by itself and leave the slacks free: --bounds law."
            )


def _rows_up_to(count: int) -> str:
    return "no row" if count == 0 else "row 1" if count == 1 else f"rows 1 to {count}"


def _excluded(law: ForceLaw, rows: FitRows, box: CoefficientBounds) -> str:
    """Which coefficients the box cuts, with the first current at which it does; an empty text for none."""
    sentences = []
    for k, basis in enumerate(law.basis):
        for i in rows.currents:
            at = rows.current == i
            columns = law.columns(rows.distance[at], {})
            value = active_set_least_squares(columns, rows.force[at], np.ones(int(at.sum())), box.lower)[k]
            if value > box.upper[k]:
                sentences.append(
                    f"The upper bound {box.upper[k]:g} of {basis} alone excludes {value:.3g} "
                    f"{law.coefficient_units[k]}, which the data at {i:g} A ask for. "
                )
                break
    return "".join(sentences)


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
