"""Newton's iteration as energy minimisation.

The state w minimises E(w) = stored energy - currents x flux linkages, which is convex because every H(B) is monotone. A
correction solves K c = -dE/dw. K, the second derivative, is kept while it serves, and corrected by what the last steps
changed of dE/dw (limited-memory BFGS); it is renewed where a start is far from the state that it was made at, where its
full step does not lower the energy, after a step that was shortened, and where the steps that are left would cost more
than a renewal. Any such K is positive definite, so c always goes downhill, and halving the step until the energy falls
enough leads to the one minimum from any start.

The residual is measured where it means energy: sqrt(c . K c / w . K w), the correction relative to the solution.

The states at all points of the currents are found each from those between it and the weakest one. With states v of a
similar problem (another distance, a lower order) as bases, a point starts from w(i) = v(i) + w(i') - v(i'), i' the
nearest point before it: wrong only in the mixed second difference. Without them it starts on the straight line through
the two points before it, or from the parallelogram of three.

References
----------
J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., sections 3.1 (sufficient decrease) and 7.2 (BFGS).
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.field.point_rows import NO_CONVERGENCE, NOT_FINITE, UNSOLVED, between, weakest

if TYPE_CHECKING:
    from femfit.field.nonlinear_system import NonlinearSystem


TOLERANCE = 1e-8
"""Relative size of the last correction, which is applied."""

LIMIT = 60
RENEWAL_COST = 8.0
"""Steps that a renewal costs: 60 ms against 8 ms at 30,000 unknowns of order 5 (push solenoid, relay, voice coil)."""

MEMORY = 8  # steps by which a kept derivative is corrected

NEAR = 3e-3
"""A start whose first correction is larger is too far for the derivative at another current: to renew it at once halves
the work (push solenoid, relay). From 1e-4 to 1e-2 the number does not matter."""

SUFFICIENT = 1e-4
SHORTEST_STEP = 2.0**-30
RESOLVED = 1e-6
"""Corrections below this change the energy by less than its rounding, so that the search has nothing to compare."""

MOST_SOLVER_ERROR = 0.1
"""Conventional: a correction that solves its equations to a tenth leads downhill as well as an exact one. Where a
kinked curve keeps the iteration from its end it is below 0.004."""


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
    # Relative error of the last correction as a solution of its equations; where it is not small, the mesh is at fault
    solver_error: float = 0.0

    @property
    def failure(self) -> str:
        """The status of the point where the iteration did not converge."""
        if not math.isfinite(self.residual):
            return f"failed: {NOT_FINITE}"
        return UNSOLVED if self.solver_error > MOST_SOLVER_ERROR else NO_CONVERGENCE


def minimise(
    problem: "NonlinearSystem",
    currents: FloatArray,
    start: FloatArray,
    *,
    tolerance: float = TOLERANCE,
    renewal_cost: float = RENEWAL_COST,
    limit: int = LIMIT,
) -> NewtonResult:
    """Find the state of least energy."""
    state, evaluated, history = start, problem.evaluate(start, currents), list[float]()
    stale, steps = not problem.ready, deque[_Step](maxlen=MEMORY)
    while len(history) < limit:
        fresh = stale
        if fresh:
            problem.renew(state)
            steps.clear()
        correction = _correction(problem, evaluated.gradient, steps)
        decrease = -inner(evaluated.gradient, correction)
        scale = max(evaluated.square, decrease)
        residual = math.sqrt(max(decrease, 0.0) / scale) if scale != 0.0 else 0.0
        if not math.isfinite(residual):
            return NewtonResult(state, len(history), residual, False, tuple(history))
        stale = not fresh and not history and residual > NEAR
        if stale:
            continue
        slow = not fresh and bool(history) and _steps_left(history[-1], residual, tolerance) > renewal_cost
        history.append(residual)
        if residual <= tolerance:
            return NewtonResult(state + correction, len(history), residual, True, tuple(history))
        shortest = 1.0 if residual < RESOLVED or not fresh else SHORTEST_STEP
        before, step = evaluated.gradient, 1.0
        while True:  # the first step of 1, 1/2, 1/4 ... that lowers the energy enough, or the shortest one
            trial = state + step * correction
            tried = problem.evaluate(trial, currents)
            enough = tried.energy <= evaluated.energy - SUFFICIENT * step * decrease
            if enough or step <= shortest:
                break
            step *= 0.5
        stale = residual >= RESOLVED and not enough
        if stale and not fresh:
            history.pop()  # a renewed derivative from here is better than a short step by one that misleads
            continue
        state, evaluated = trial, tried
        moved, bent = step * correction, evaluated.gradient - before
        product = inner(moved, bent)
        if product > 0.0:  # as of any convex energy, but for rounding
            steps.append(_Step(moved, bent, product))
        stale = renewal_cost == 0.0 or step < 1.0 or slow
    return NewtonResult(state, limit, history[-1], False, tuple(history), _solver_error(problem, state, currents))


@dataclass(frozen=True, eq=False)
class _Step:
    """What a step changed: the state, dE/dw, and the product of the two in J."""

    state: FloatArray
    gradient: FloatArray
    product: float


def _correction(problem: "NonlinearSystem", gradient: FloatArray, steps: deque[_Step]) -> FloatArray:
    """-dE/dw over the kept derivative as the last steps correct it: the two loops of limited-memory BFGS."""
    rest, shares = -gradient, list[float]()
    for step in reversed(steps):
        shares.append(inner(step.state, rest) / step.product)
        rest = rest - shares[-1] * step.gradient
    correction = problem.solve(rest)
    for step, share in zip(steps, reversed(shares), strict=True):
        correction = correction + (share - inner(step.gradient, correction) / step.product) * step.state
    return correction


def _solver_error(problem: "NonlinearSystem", state: FloatArray, currents: FloatArray) -> float:
    """What a correction leaves of dE/dw, by the difference over a small part of it, relative along the correction."""
    problem.renew(state)
    gradient = problem.evaluate(state, currents).gradient
    correction = problem.solve(-gradient)
    change = problem.evaluate(state + RESOLVED * correction, currents).gradient - gradient
    return abs(inner(change / RESOLVED + gradient, correction) / (inner(gradient, correction) or 1.0))


def _steps_left(before: float, residual: float, tolerance: float) -> float:
    """Steps until the tolerance, if each reduces the residual as the last one did."""
    if residual <= tolerance:
        return 0.0
    return math.log(tolerance / residual) / math.log(residual / before) if residual < before else math.inf


States: TypeAlias = dict[tuple[float, ...], FloatArray]
"""States by their currents in A."""


def along_currents(
    system: "NonlinearSystem", points: FloatArray, bases: States, tolerance: float
) -> Iterator[tuple[tuple[float, ...], NewtonResult]]:
    """Solve at currents in A of shape (points, circuits), from the weakest outwards, each as it is asked for."""
    states: States = {}
    for point, before in outwards(points):
        key, start = tuple(point), _predicted(point, [i for i in before if tuple(i) in states], states, bases)
        start = np.zeros(system.space.ndof) if start is None else start
        result = minimise(system, point, start, tolerance=tolerance)
        if result.converged:
            states[key] = result.state
        yield key, result


def outwards(points: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Each point from the weakest outwards, with those between it and the weakest, the nearest first.

    One side after the other, and the last current fastest: neighbours follow each other, whose derivatives are alike.
    """
    if not len(points):
        return []
    scale = np.maximum(np.ptp(points, axis=0), np.finfo(float).tiny)
    middle = points[weakest(points)]
    order = np.lexsort([key for step in (points - middle).T[::-1] for key in (np.abs(step), step < 0.0)] or [[0]])
    path = []
    for place, k in enumerate(order):
        solved = points[order[:place]]
        before = solved[between(solved, points[k], middle)]
        nearest = np.argsort(np.linalg.norm((before - points[k]) / scale, axis=1), kind="stable")
        path.append((points[k], before[nearest]))
    return path


def _predicted(
    point: FloatArray, before: list[FloatArray], states: Mapping[tuple[float, ...], FloatArray], bases: States
) -> FloatArray | None:
    """The start at a point from the states before it, the nearest first."""
    if tuple(point) in bases:
        base = bases[tuple(point)]
        neighbours = [tuple(i) for i in before if tuple(i) in bases]
        return base + states[neighbours[0]] - bases[neighbours[0]] if neighbours else base
    if not before:
        return None
    nearest = before[0]
    state, step = states[tuple(nearest)], point - nearest
    for neighbour in before[1:]:
        back = nearest - neighbour
        if np.count_nonzero(step) == np.count_nonzero(back) == np.count_nonzero((step != 0.0) & (back != 0.0)) == 1:
            share = np.sum(step) / np.sum(back)
            return np.asarray(state + share * (state - states[tuple(neighbour)]))
        if tuple(neighbour + step) in states:  # the fourth corner of a parallelogram
            return np.asarray(state + states[tuple(neighbour + step)] - states[tuple(neighbour)])
    return state
