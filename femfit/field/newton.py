r"""Newton's iteration as energy minimisation.

The state w minimises E(w) = stored energy - currents x flux linkages, which is convex because every H(B) is monotone. A
correction solves K c = -dE/dw; K, the second derivative, is kept while it serves: it is renewed after a step that was
shortened or reduced the residual too little. Any such K is positive definite, so c always goes downhill, and halving
the step until the energy falls enough leads to the one minimum from any start.

The residual is measured where it means energy: sqrt(c . K c / w . K w), the correction relative to the solution.

References
----------
J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., section 3.1 (sufficient decrease).
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.arrays import FloatArray

if TYPE_CHECKING:
    from femfit.field.nonlinear_system import NonlinearSystem

TOLERANCE = 1e-8
"""Relative size of the last correction. It is applied, and what is left after it is at most a tenth of it."""

LIMIT = 60
CONTRACTION = 0.1
"""A kept derivative is renewed when a step leaves more than this part of the correction: a renewal costs four steps."""

SUFFICIENT = 1e-4
SHORTEST_STEP = 2.0**-30
RESOLVED = 1e-6
"""Corrections below this change the energy by less than its rounding, so that the search has nothing to compare."""


def inner(a: FloatArray, b: FloatArray) -> float:
    """Sum of a b, in one thread.

    BLAS splits long products over threads, whose waiting costs a hundred times the product where all cores are at work;
    and the digits would depend on the number of threads, which a resumed sweep must not.
    """
    return float(np.einsum("i,i->", a, b))


@dataclass(frozen=True, eq=False)
class Expansion:
    """The energy about a state."""

    energy: float  # E in J
    gradient: FloatArray  # dE/dw; shape (unknowns,)
    square: float  # w . K w of the state itself, J: the scale of corrections


@dataclass(frozen=True, eq=False)
class NewtonResult:
    """How an iteration ended."""

    state: FloatArray  # The last state; shape (unknowns,)
    iterations: int
    residual: float  # The last correction relative to the solution, in the energy's norm
    converged: bool
    history: tuple[float, ...]


def minimise(
    problem: "NonlinearSystem",
    currents: FloatArray,
    start: FloatArray,
    *,
    contraction: float = CONTRACTION,
    limit: int = LIMIT,
) -> NewtonResult:
    """Find the state of least energy."""
    state, here, history = start, problem.evaluate(start, currents), list[float]()
    stale = not problem.ready
    for _ in range(limit):
        if stale:
            problem.renew(state)
        correction = problem.solve(-here.gradient)
        decrease = -inner(here.gradient, correction)
        residual = _relative(decrease, here.square)
        if not math.isfinite(residual):
            return NewtonResult(state, len(history), residual, False, tuple(history))
        slow = bool(history) and residual > contraction * history[-1]
        history.append(residual)
        if residual <= TOLERANCE:
            return NewtonResult(state + correction, len(history), residual, True, tuple(history))
        least = 1.0 if residual < RESOLVED else SHORTEST_STEP
        step, state, here = _search(problem, currents, state, here, correction, least, SUFFICIENT * decrease)
        stale = contraction == 0.0 or step < 1.0 or slow
    return NewtonResult(state, limit, history[-1], False, tuple(history))


def _relative(decrease: float, square: float) -> float:
    scale = max(square, decrease)
    return math.sqrt(max(decrease, 0.0) / scale) if scale != 0.0 else 0.0


def _search(
    problem: "NonlinearSystem",
    currents: FloatArray,
    state: FloatArray,
    here: Expansion,
    correction: FloatArray,
    least: float,
    decrease: float,
) -> tuple[float, FloatArray, Expansion]:
    """The first step of 1, 1/2, 1/4 ... that lowers the energy enough, or the least one; and where it leads."""
    step = 1.0
    while True:
        trial = state + step * correction
        there = problem.evaluate(trial, currents)
        if step <= least or there.energy <= here.energy - step * decrease:
            return step, trial, there
        step *= 0.5
