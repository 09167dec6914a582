"""A force law with its coefficient functions as one linear model: columns phi_k(d) i^n and their bounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.errors import UsageError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.fit.bounded_qp import Inequalities, QPSolution, active_set_least_squares, solve_bounded_qp
from femfit.laws.law import ForceLaw

FUNCTIONS: dict[str, tuple[int, ...]] = {
    "constant": (0,),
    "through-origin": (1,),
    "square": (2,),
    "affine": (0, 1),
    "quadratic": (0, 1, 2),
}
"""Coefficient functions of the current: name and powers, simplest first; a coil alone pulls iron with its square."""


@dataclass(frozen=True, eq=False)
class CoefficientBounds:
    """What each coefficient c_k(i) may be, at the currents of the sweep."""

    # One entry a column of the law; infinite where nothing is bounded; shape (k,)
    lower: FloatArray
    upper: FloatArray
    # Columns whose bounds hold at currents >= 0 alone, in which the coil attracts: b(i) = m i changes its sign with
    # the current. None for none of them; shape (k,)
    attracting: BoolArray | None = None

    def at(self, current: float) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds at a current in A."""
        if self.attracting is None or current >= 0:
            return self.lower, self.upper
        return np.where(self.attracting, -np.inf, self.lower), np.where(self.attracting, np.inf, self.upper)

    def with_single(self, law: ForceLaw, single: Mapping[str, tuple[float, float]]) -> "CoefficientBounds":
        """These bounds with those of single columns given by hand, which hold at every current."""
        lower, upper = self.lower.copy(), self.upper.copy()
        for basis, ends in single.items():
            if basis not in law.basis:
                raise UsageError(f"Law {law.name} has the coefficients of {', '.join(law.basis)}; none of {basis!r}.")
            lower[law.basis.index(basis)], upper[law.basis.index(basis)] = ends
        attracting = None if self.attracting is None else self.attracting & ~np.isin(law.basis, list(single))
        return CoefficientBounds(lower, upper, attracting)

    def of_column(self, k: int) -> "CoefficientBounds":
        """The bounds of one column."""
        column = slice(k, k + 1)
        return CoefficientBounds(
            self.lower[column], self.upper[column], None if self.attracting is None else self.attracting[column]
        )


def default_bounds(law: ForceLaw) -> CoefficientBounds:
    """The law's own: coefficients that it calls non-negative, at each current in which the coil attracts.

    At negative currents the coil's part of the force, b(i) = m i, repels, and a bound there would leave only b = 0.
    """
    nonnegative = law.nonnegative or (False,) * len(law.basis)
    return CoefficientBounds(
        np.where(nonnegative, 0.0, -np.inf), np.full(len(law.basis), np.inf), np.array(nonnegative)
    )


def term_names(law: ForceLaw, functions: Sequence[str]) -> tuple[tuple[str, int], ...]:
    """(column, power of current) of every term, in the order of :func:`design_matrix`."""
    return tuple((basis, power) for basis, name in zip(law.basis, functions, strict=True) for power in FUNCTIONS[name])


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
    inequalities: Inequalities | None
    sides: tuple[str, ...]  # ``lower`` or ``upper`` for each inequality

    def solve(self, matrix: FloatArray, y: FloatArray, sigma: FloatArray) -> QPSolution:
        """The least squares within them, proved."""
        return solve_bounded_qp(matrix, y, sigma, self.lower, self.upper, self.inequalities, self.names)

    def refit(self, matrix: FloatArray, y: FloatArray, sigma: FloatArray) -> FloatArray:
        """The same quickly and without proof."""
        return active_set_least_squares(matrix, y, sigma, self.lower, self.upper, self.inequalities)

    def active(self, solution: QPSolution) -> tuple[str, ...]:
        """The bounds that a solution stands on, in words."""
        box = [f"{name} on its {side} bound" for name, side in zip(self.names, solution.active, strict=True) if side]
        if self.inequalities is None:
            return tuple(box)
        labels = self.inequalities.labels
        return (*box, *(w for w, hit in zip(labels, solution.active_inequalities, strict=True) if hit))

    def active_sides(self, solution: QPSolution) -> tuple[str, ...]:
        """For each term ``lower``, ``upper`` or empty: the side on which its coefficient is bound at any current."""
        sides = list(solution.active)
        if self.inequalities is not None:
            for row, side, hit in zip(self.inequalities.matrix, self.sides, solution.active_inequalities, strict=True):
                for term in np.flatnonzero(row) if hit else ():
                    sides[term] = sides[term] or side
        return tuple(sides)


def term_bounds(
    functions: Sequence[str], labels: Sequence[str], currents: FloatArray, bounds: CoefficientBounds
) -> TermBounds:
    """Bounds on c_k(i) at each current: a box where one term makes it up, inequalities where it has more."""
    total = sum(len(FUNCTIONS[name]) for name in functions)
    lower, upper = np.full(total, -np.inf), np.full(total, np.inf)
    rows: list[FloatArray] = []
    right: list[float] = []
    words: list[str] = []
    sides: list[str] = []
    start = 0
    for k, name in enumerate(functions):
        powers = np.array(FUNCTIONS[name], dtype=np.float64)
        for i in currents:
            row = np.zeros(total)
            row[start : start + len(powers)] = i**powers
            only = np.flatnonzero(row)
            low, high = bounds.at(float(i))
            for limit, sign, word in ((low[k], 1.0, "lower"), (high[k], -1.0, "upper")):
                if not np.isfinite(limit) or len(only) == 0:
                    continue
                if len(only) == 1:
                    # sign row x >= sign limit bounds this term alone, from below where the row's entry has that sign.
                    entry = row[only[0]]
                    if sign * entry > 0:
                        lower[only[0]] = max(lower[only[0]], limit / entry)
                    else:
                        upper[only[0]] = min(upper[only[0]], limit / entry)
                else:
                    rows.append(sign * row)
                    right.append(sign * limit)
                    words.append(f"{labels[k]} at {i:g} A on its {word} bound {limit:g}")
                    sides.append(word)
        start += len(powers)
    inequalities = Inequalities(np.array(rows), np.array(right), tuple(words)) if rows else None
    names = (f"{labels[k]} i^{power}" for k, name in enumerate(functions) for power in FUNCTIONS[name])
    return TermBounds(tuple(names), lower, upper, inequalities, tuple(sides))
