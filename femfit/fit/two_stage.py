"""A law in two stages: at each current by itself, then each coefficient as a function of the current.

Stage one minimises J_1 = sum_j (F_j - sum_k c_k phi_k(d_j))^2 at each current by itself; stage two fits the values
c_k(i) with a constant, a line through the origin, a square, a line or a parabola, and J_3 is its sum of squares. Which
of them is taken is decided by leaving each current out in turn, not by eye.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (5) to (13).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.errors import FitError, InfeasibleFitError
from femfit.core.numerics import FloatArray
from femfit.fit.bounded_qp import QPSolution, solve_bounded_qp
from femfit.fit.constants import FEWEST_CURRENTS
from femfit.fit.law_columns import FUNCTIONS, CoefficientBounds, term_bounds
from femfit.fit.rows import FitRows
from femfit.laws.law import ForceLaw


@dataclass(frozen=True, eq=False)
class StageOne:
    """A law fitted at each current by itself."""

    currents: FloatArray  # A; shape (m,)
    coefficients: FloatArray  # c_k at each current; shape (m, k)
    residual_sums: FloatArray  # J in N^2; shape (m,)
    solutions: tuple[QPSolution, ...]


@dataclass(frozen=True, eq=False)
class CoefficientFunction:
    """A coefficient as a polynomial of the current."""

    name: str
    values: FloatArray
    residual_sum: float
    held_out: Mapping[str, float]  # Root mean square error at the current left out, for every function that was tried

    def at(self, current: FloatArray) -> FloatArray:
        """c(i) at currents in A."""
        return np.asarray(_monomials(self.name, np.asarray(current)) @ self.values)


def fit_each_current(
    law: ForceLaw, shape: Mapping[str, float], rows: FitRows, sigma: FloatArray, bounds: CoefficientBounds
) -> StageOne:
    """Stage one, with the law's shape the same at all currents; FitError if there are fewer than three."""
    currents = rows.currents
    if len(currents) < FEWEST_CURRENTS and not rows.without_current:
        listed = ", ".join(f"{i:g} A" for i in currents)
        raise FitError(
            f"Two stages need at least {FEWEST_CURRENTS} currents, to leave one out and still distinguish a line "
            f"from a constant; the table holds {len(currents)} ({listed}). Sweep or import more currents."
        )
    solutions, sums = [], []
    for i in currents:
        at_current = rows.current == i
        columns = law.columns(rows.distance[at_current], shape)
        names = [f"{basis} at {i:g} A" for basis in law.basis]
        solution = solve_bounded_qp(
            columns, rows.force[at_current], sigma[at_current], *bounds.at(float(i)), names=names
        )
        solutions.append(solution)
        sums.append(float(np.sum(solution.residual**2)))
    return StageOne(currents, np.array([s.x for s in solutions]), np.array(sums), tuple(solutions))


def fit_coefficient_function(
    currents: FloatArray,
    values: FloatArray,
    label: str,
    bounds: CoefficientBounds | None = None,
    name: str | None = None,
    negligible: float = 0.0,
) -> CoefficientFunction:
    """Stage two for one coefficient.

    The simplest function is taken whose mean squared held-out error lies within one standard error of the best one's
    (Breiman et al.), or below ``negligible``.
    Values are c at each current, bounds those of c, one column; ``negligible`` is in the coefficient's unit.

    References
    ----------
    L. Breiman et al., Classification and Regression Trees (Wadsworth, 1984), section 3.4.3 (one standard error).
    """
    bounds = bounds or CoefficientBounds(np.array([-np.inf]), np.array([np.inf]))
    squares = _held_out_squares(currents, values, bounds)
    if name is None and not squares:
        raise InfeasibleFitError(
            f"No coefficient function of {label} is feasible within {bounds.lower[0]:g}..{bounds.upper[0]:g}. "
            "Widen these bounds."
        )
    solver_noise = 1e-7 * float(np.sqrt(np.mean(values**2)))
    chosen = name or _simplest(squares, max(negligible, solver_noise))
    limits = term_bounds([chosen], [label], currents, bounds)
    solution = limits.solve(_monomials(chosen, currents), values, np.ones(len(values)))
    return CoefficientFunction(
        name=chosen,
        values=solution.x,
        residual_sum=float(np.sum(solution.residual**2)),
        held_out={trial: float(np.sqrt(np.mean(s))) for trial, s in squares.items()},
    )


def _monomials(name: str, currents: FloatArray) -> FloatArray:
    return np.asarray(np.power(currents[..., None], np.array(FUNCTIONS[name], dtype=np.float64)))


def _held_out_squares(currents: FloatArray, values: FloatArray, bounds: CoefficientBounds) -> dict[str, FloatArray]:
    """Squared error at each current left out, for every function that the bounds allow."""
    squares = {}
    for name, powers in FUNCTIONS.items():
        if len(currents) <= len(powers):  # with one left out they must determine it, with one point to spare in all
            continue
        monomials = _monomials(name, currents)
        errors = []
        try:
            for out in range(len(currents)):
                fitted = np.arange(len(currents)) != out
                limits = term_bounds([name], ["c"], currents[fitted], bounds)
                x = limits.refit(monomials[fitted], values[fitted], np.ones(len(currents) - 1))
                errors.append(float(monomials[out] @ x - values[out]))
        except InfeasibleFitError:
            continue
        squares[name] = np.array(errors) ** 2
    return squares


def _simplest(squares: Mapping[str, FloatArray], negligible: float) -> str:
    best = min(squares.values(), key=lambda s: float(np.mean(s)))
    allowed = max(float(np.mean(best) + np.std(best, ddof=1) / np.sqrt(len(best))), negligible**2)
    return next(name for name, s in squares.items() if np.mean(s) <= allowed)


def fit_functions(
    law: ForceLaw,
    stage_one: StageOne,
    bounds: CoefficientBounds,
    functions: Sequence[str] | None = None,
    negligible: FloatArray | None = None,
) -> tuple[CoefficientFunction, ...]:
    """Stage two for every coefficient of a law; arguments as of :func:`fit_coefficient_function`, one a column."""
    return tuple(
        fit_coefficient_function(
            stage_one.currents,
            stage_one.coefficients[:, k],
            basis,
            bounds.of_column(k),
            None if functions is None else functions[k],
            0.0 if negligible is None else float(negligible[k]),
        )
        for k, basis in enumerate(law.basis)
    )
