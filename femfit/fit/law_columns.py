"""A force law with its coefficient functions as one linear model: columns phi_k(d) i^n and their bounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.fit.bounded_qp import Inequalities
from femfit.laws.law import ForceLaw

FUNCTIONS: dict[str, tuple[int, ...]] = {
    "constant": (0,),
    "through-origin": (1,),
    "affine": (0, 1),
    "quadratic": (0, 1, 2),
}
"""Coefficient functions of the current: name and powers, simplest first."""


@dataclass(frozen=True, eq=False)
class CoefficientBounds:
    """What each coefficient c_k(i) may be, at every current of the sweep.

    Parameters
    ----------
    lower, upper : array, shape (k,)
        One entry a column of the law; infinite where nothing is bounded.
    """

    lower: FloatArray
    upper: FloatArray


def term_names(law: ForceLaw, functions: Sequence[str]) -> tuple[tuple[str, int], ...]:
    """(column, power of current) of every term, in the order of :func:`design_matrix`.

    Parameters
    ----------
    law : ForceLaw
        Any.
    functions : sequence of str
        One of :data:`FUNCTIONS` for each column.

    Returns
    -------
    tuple of (str, int)
        Names.
    """
    return tuple((basis, power) for basis, name in zip(law.basis, functions, strict=True) for power in FUNCTIONS[name])


def design_matrix(
    law: ForceLaw, shape: Mapping[str, float], functions: Sequence[str], distance: FloatArray, current: FloatArray
) -> FloatArray:
    """Columns phi_k(d) i^n.

    Parameters
    ----------
    law : ForceLaw
        Any.
    shape : mapping of str to float
        Its nonlinear parameters.
    functions : sequence of str
        One of :data:`FUNCTIONS` for each column.
    distance, current : array, shape (n,)
        Rows.

    Returns
    -------
    array, shape (n, terms)
        One column a term.
    """
    phi = law.columns(distance, shape)
    return np.stack(
        [phi[:, k] * current**power for k, name in enumerate(functions) for power in FUNCTIONS[name]], axis=1
    )


def term_bounds(
    functions: Sequence[str], labels: Sequence[str], currents: FloatArray, bounds: CoefficientBounds
) -> tuple[FloatArray, FloatArray, Inequalities | None]:
    """Bounds on c_k(i) at every current, as a box where a function has one term and as inequalities where it has more.

    Parameters
    ----------
    functions : sequence of str
        One of :data:`FUNCTIONS` for each column.
    labels : sequence of str
        Name of each column, for reports.
    currents : array
        Distinct currents of the sweep, A.
    bounds : CoefficientBounds
        On c_k(i).

    Returns
    -------
    tuple of lower, upper and Inequalities or None
        For the terms.
    """
    total = sum(len(FUNCTIONS[name]) for name in functions)
    lower, upper = np.full(total, -np.inf), np.full(total, np.inf)
    rows: list[FloatArray] = []
    right: list[float] = []
    words: list[str] = []
    start = 0
    for k, name in enumerate(functions):
        powers = np.array(FUNCTIONS[name])
        low, high = bounds.lower[k], bounds.upper[k]
        for i in currents:
            monomials = i ** powers.astype(np.float64)
            if len(powers) == 1 and monomials[0] != 0.0:
                ends = sorted((low / monomials[0], high / monomials[0]))
                lower[start], upper[start] = max(lower[start], ends[0]), min(upper[start], ends[1])
            elif len(powers) > 1:
                row = np.zeros(total)
                row[start : start + len(powers)] = monomials
                for limit, sign, word in ((low, 1.0, "lower"), (high, -1.0, "upper")):
                    if np.isfinite(limit):
                        rows.append(sign * row)
                        right.append(sign * limit)
                        words.append(f"{labels[k]} at {i:g} A on its {word} bound {limit:g}")
        start += len(powers)
    found = Inequalities(np.array(rows), np.array(right), tuple(words)) if rows else None
    return lower, upper, found
