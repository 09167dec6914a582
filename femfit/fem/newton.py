r"""Newton's iteration as energy minimisation.

The state w minimises E(w) = stored energy - current x flux linkage, which is convex because every H(B) is monotone. A
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
from typing import Protocol

from femfit.core.arrays import FloatArray
from femfit.fem.inner import inner

TOLERANCE = 1e-9
"""Of the relative correction that is still applied: energies are exact to its square, forces and fluxes to itself."""

LIMIT = 60
CONTRACTION = 0.1
"""A kept derivative is renewed when a step leaves more than this part of the correction: a renewal costs four steps."""

SUFFICIENT = 1e-4
SHORTEST_STEP = 2.0**-30
RESOLVED = 1e-6
"""Corrections below this change the energy by less than its rounding, so that the search has nothing to compare."""


class MinimisationProblem(Protocol):
    """What is minimised, for one current."""

    def energy(self, state: FloatArray, current: float) -> float:
        """E in J."""

    def gradient(self, state: FloatArray, current: float) -> FloatArray:
        """dE/dw."""

    def square(self, state: FloatArray) -> float:
        """Product w . K w with the secant reluctivity, in J."""

    def renew(self, state: FloatArray) -> None:
        """Take K at a state."""

    def solve(self, load: FloatArray) -> FloatArray:
        """K^-1 load."""

    @property
    def ready(self) -> bool:
        """Whether there is a K."""


@dataclass(frozen=True)
class NewtonResult:
    """How an iteration ended.

    Parameters
    ----------
    state : array, shape (unknowns,)
        The last state.
    iterations : int
        Corrections applied.
    residual : float
        The last correction relative to the solution, in the energy's norm.
    converged : bool
        Whether the residual is below the tolerance.
    history : tuple of float
        The residual of each iteration.
    """

    state: FloatArray
    iterations: int
    residual: float
    converged: bool
    history: tuple[float, ...]


def minimise(
    problem: MinimisationProblem,
    current: float,
    start: FloatArray,
    *,
    contraction: float = CONTRACTION,
    limit: int = LIMIT,
) -> NewtonResult:
    """Find the state of least energy.

    Parameters
    ----------
    problem : MinimisationProblem
        Convex.
    current : float
        In A.
    start : array, shape (unknowns,)
        First state.
    contraction : float
        0 renews the derivative in every iteration: Newton's own method.
    limit : int
        Of iterations.

    Returns
    -------
    NewtonResult
        Also when it did not converge.
    """
    state, history = start, list[float]()
    stale = not problem.ready
    for _ in range(limit):
        gradient = problem.gradient(state, current)
        if stale:
            problem.renew(state)
        correction = problem.solve(-gradient)
        decrease = -inner(gradient, correction)
        residual = _relative(decrease, problem.square(state))
        if not math.isfinite(residual):
            return NewtonResult(state, len(history), residual, False, tuple(history))
        step = 1.0 if residual < RESOLVED else _step(problem, current, state, correction, decrease)
        state = state + step * correction
        slow = bool(history) and residual > contraction * history[-1]
        history.append(residual)
        if residual <= TOLERANCE:
            return NewtonResult(state, len(history), residual, True, tuple(history))
        stale = contraction == 0.0 or step < 1.0 or slow
    return NewtonResult(state, limit, history[-1], False, tuple(history))


def _relative(decrease: float, square: float) -> float:
    scale = max(square, decrease)
    return math.sqrt(max(decrease, 0.0) / scale) if scale != 0.0 else 0.0


def _step(
    problem: MinimisationProblem, current: float, state: FloatArray, correction: FloatArray, decrease: float
) -> float:
    """The first of 1, 1/2, 1/4 ... with a sufficient decrease of the energy."""
    before, step = problem.energy(state, current), 1.0
    while step > SHORTEST_STEP:
        if problem.energy(state + step * correction, current) <= before - SUFFICIENT * step * decrease:
            break
        step *= 0.5
    return step
