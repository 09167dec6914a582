"""A force law with its coefficient functions as one linear model, phi_k(d) i^n, and the law in two stages.

It is fitted at each current by itself, then each coefficient as a function of the current.

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

from femfit.core.errors import FitError, InfeasibleFitError, UsageError
from femfit.core.numerics import FloatArray
from femfit.fit.bounded_qp import BoundedQP, Inequalities, QPSolution
from femfit.fit.constants import FEWEST_CURRENTS
from femfit.fit.rows import FitRows
from femfit.laws.law import ForceLaw

FUNCTIONS: dict[str, tuple[int, ...]] = {
    "constant": (0,),
    "through-origin": (1,),
    "square": (2,),
    "affine": (0, 1),
    "quadratic": (0, 1, 2),
}
"""Coefficient functions of the current: name and powers, simplest first; a coil alone pulls iron with its square."""


def coefficient_bounds(
    law: ForceLaw, currents: FloatArray, single: Mapping[str, tuple[float, float]] | None = None
) -> FloatArray:
    """Lowest and highest coefficient of each column at each current (m,); infinite for none; shape (2, m, k).

    A coefficient that the law calls non-negative is so at each current in which the coil attracts: at negative ones the
    coil's part of the force, b(i) = m i, repels, and a bound there would leave only b = 0. Those of single columns hold
    at every current in place of the law's own.
    """
    nonnegative = np.array(law.nonnegative or (False,) * len(law.basis))
    lower = np.where(nonnegative & (currents[:, None] >= 0.0), 0.0, -np.inf)
    bounds = np.stack([lower, np.full_like(lower, np.inf)])
    for basis, ends in (single or {}).items():
        if basis not in law.basis:
            raise UsageError(f"Law {law.name} has the coefficients of {', '.join(law.basis)}; none of {basis!r}.")
        bounds[:, :, law.basis.index(basis)] = np.reshape(ends, (2, 1))
    return bounds


def design_matrix(
    law: ForceLaw, shape: Mapping[str, float], functions: Sequence[str], distance: FloatArray, current: FloatArray
) -> FloatArray:
    """Columns phi_k(d) i^n, shape (n, terms), for a function of :data:`FUNCTIONS` for each column of the law."""
    phi = law.columns(distance, shape)
    return np.stack(
        [phi[:, k] * current**power for k, name in enumerate(functions) for power in FUNCTIONS[name]], axis=1
    )


@dataclass(frozen=True, eq=False)
class TermBounds:
    """Bounds on c_k(i) at every current, written for the terms of its polynomial."""

    names: tuple[str, ...]
    # A box, from currents at which a single term makes up the coefficient; shape (terms,)
    lower: FloatArray
    upper: FloatArray
    inequalities: Inequalities  # Perhaps none
    sides: tuple[str, ...]  # ``lower`` or ``upper`` for each inequality

    def problem(self, matrix: FloatArray, y: FloatArray, sigma: FloatArray) -> BoundedQP:
        """The least squares within them."""
        return BoundedQP(matrix, y, sigma, self.lower, self.upper, self.inequalities, self.names)

    def active(self, solution: QPSolution) -> tuple[str, ...]:
        """The bounds that a solution stands on, in words."""
        box = [f"{name} on its {side} bound" for name, side in zip(self.names, solution.active, strict=True) if side]
        labels = zip(self.inequalities.labels, solution.active_inequalities, strict=True)
        return (*box, *(label for label, hit in labels if hit))

    def active_sides(self, solution: QPSolution) -> tuple[str, ...]:
        """For each term ``lower``, ``upper`` or empty: the side on which its coefficient is bound at any current."""
        sides = list(solution.active)
        for row, side, hit in zip(self.inequalities.matrix, self.sides, solution.active_inequalities, strict=True):
            for term in np.flatnonzero(row) if hit else ():
                sides[term] = sides[term] or side
        return tuple(sides)


def term_bounds(
    functions: Sequence[str], labels: Sequence[str], currents: FloatArray, bounds: FloatArray
) -> TermBounds:
    """Bounds (2, m, k) on c_k(i) at each current: a box where one term makes it up, inequalities where it has more."""
    owner, powers = np.array([(k, power) for k, name in enumerate(functions) for power in FUNCTIONS[name]]).T
    lower, upper = np.full(len(owner), -np.inf), np.full(len(owner), np.inf)
    rows, right, words, sides = list[FloatArray](), list[float](), list[str](), list[str]()
    for k, label in enumerate(labels):
        for i, ends in zip(currents, bounds[:, :, k].T, strict=True):
            row = np.where(owner == k, float(i) ** powers, 0.0)
            terms = np.flatnonzero(row)
            for limit, sign, side in zip(ends, (1.0, -1.0), ("lower", "upper"), strict=True):
                if not np.isfinite(limit) or len(terms) == 0:
                    continue
                if len(terms) > 1:
                    rows.append(sign * row)
                    right.append(sign * limit)
                    words.append(f"{label} at {i:g} A on its {side} bound {limit:g}")
                    sides.append(side)
                elif sign * row[terms[0]] > 0.0:  # it bounds this term alone, from below where the entry has that sign
                    lower[terms] = np.maximum(lower[terms], limit / row[terms])
                else:
                    upper[terms] = np.minimum(upper[terms], limit / row[terms])
    inequalities = Inequalities(np.reshape(rows, (-1, len(owner))), np.array(right), tuple(words))
    names = tuple(f"{labels[k]} i^{power}" for k, power in zip(owner, powers, strict=True))
    return TermBounds(names, lower, upper, inequalities, tuple(sides))


@dataclass(frozen=True, eq=False)
class CoefficientFunction:
    """A coefficient as a polynomial of the current."""

    name: str
    values: FloatArray
    held_out: Mapping[str, float]  # Root mean square error at the current left out, for every function that was tried

    def at(self, current: FloatArray) -> FloatArray:
        """c(i) at currents in A."""
        return np.asarray(_monomials(self.name, np.asarray(current)) @ self.values)


def fit_each_current(
    law: ForceLaw, shape: Mapping[str, float], rows: FitRows, sigma: FloatArray, bounds: FloatArray
) -> FloatArray:
    """Stage one, c_k at each current, shape (m, k), with the law's shape the same at all currents.

    Raises
    ------
    FitError
        If there are fewer than three currents.
    """
    currents = rows.currents
    if len(currents) < FEWEST_CURRENTS and not rows.without_current:
        listed = ", ".join(f"{i:g} A" for i in currents)
        raise FitError(
            f"Two stages need at least {FEWEST_CURRENTS} currents, to leave one out and still distinguish a line "
            f"from a constant; the table holds {len(currents)} ({listed}). Sweep or import more currents."
        )
    coefficients = []
    for i, (lower, upper) in zip(currents, bounds.swapaxes(0, 1), strict=True):
        at_current = rows.current == i
        columns = law.columns(rows.distance[at_current], shape)
        names = [f"{basis} at {i:g} A" for basis in law.basis]
        force, weights = rows.force[at_current], sigma[at_current]
        coefficients.append(BoundedQP(columns, force, weights, lower, upper, names=names).solve().x)
    return np.array(coefficients)


def fit_coefficient_function(
    currents: FloatArray,
    values: FloatArray,
    label: str,
    bounds: FloatArray,
    name: str | None = None,
    negligible: float = 0.0,
) -> CoefficientFunction:
    """Stage two for one coefficient.

    The simplest function is taken whose mean squared held-out error lies within one standard error of the best one's
    (Breiman et al.), or below ``negligible``.
    Values are c at each current, bounds those of c, (2, m, 1); ``negligible`` is in the coefficient's unit.

    References
    ----------
    L. Breiman et al., Classification and Regression Trees (Wadsworth, 1984), section 3.4.3 (one standard error).
    """
    squares = _held_out_squares(currents, values, bounds)
    if name is None and not squares:
        raise InfeasibleFitError(
            f"No coefficient function of {label} is feasible within {bounds[0].max():g}..{bounds[1].min():g}. "
            "Widen these bounds."
        )
    if not name:
        solver_noise = 1e-7 * float(np.sqrt(np.mean(values**2)))
        best = min(squares.values(), key=lambda s: float(np.mean(s)))
        one_error_above = float(np.mean(best) + np.std(best, ddof=1) / np.sqrt(len(best)))
        allowed = max(one_error_above, max(negligible, solver_noise) ** 2)
        name = next(trial for trial, s in squares.items() if np.mean(s) <= allowed)
    limits = term_bounds([name], [label], currents, bounds)
    solution = limits.problem(_monomials(name, currents), values, np.ones(len(values))).solve()
    return CoefficientFunction(
        name=name, values=solution.x, held_out={trial: float(np.sqrt(np.mean(s))) for trial, s in squares.items()}
    )


def _monomials(name: str, currents: FloatArray) -> FloatArray:
    return np.asarray(np.power(currents[..., None], np.array(FUNCTIONS[name], dtype=np.float64)))


def _held_out_squares(currents: FloatArray, values: FloatArray, bounds: FloatArray) -> dict[str, FloatArray]:
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
                limits = term_bounds([name], ["c"], currents[fitted], bounds[:, fitted])
                ones = np.ones(len(currents) - 1)
                x = limits.problem(monomials[fitted], values[fitted], ones).solve_unproven()
                errors.append(float(monomials[out] @ x - values[out]))
        except InfeasibleFitError:
            continue
        squares[name] = np.array(errors) ** 2
    return squares
