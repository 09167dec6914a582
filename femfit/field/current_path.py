r"""The states at all points of the currents, each found from those between it and the weakest one.

With states v of a similar problem (another distance, a lower order) as bases, a point starts from
w(i) = v(i) + w(i') - v(i'), i' the nearest point before it: wrong only in the mixed second difference. Without them it
starts on the straight line through the two points before it, or from the parallelogram of three.
"""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.field.currents import between, weakest
from femfit.field.newton import NewtonResult, minimise

if TYPE_CHECKING:
    from femfit.field.nonlinear_system import NonlinearSystem

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
        known = points[order[:place]]
        before = known[between(known, points[k], middle)]
        nearest = np.argsort(np.linalg.norm((before - points[k]) / scale, axis=1), kind="stable")
        path.append((points[k], before[nearest]))
    return path


def _predicted(
    point: FloatArray, before: list[FloatArray], states: Mapping[tuple[float, ...], FloatArray], bases: States
) -> FloatArray | None:
    """The start at a point from the states before it, the nearest first."""
    if tuple(point) in bases:
        base = bases[tuple(point)]
        known = [tuple(i) for i in before if tuple(i) in bases]
        return base + states[known[0]] - bases[known[0]] if known else base
    if not before:
        return None
    nearest = before[0]
    state, step = states[tuple(nearest)], point - nearest
    for other in before[1:]:
        back = nearest - other
        if np.count_nonzero(step) == np.count_nonzero(back) == np.count_nonzero((step != 0.0) & (back != 0.0)) == 1:
            share = np.sum(step) / np.sum(back)
            return np.asarray(state + share * (state - states[tuple(other)]))
        if tuple(other + step) in states:  # the fourth corner of a parallelogram
            return np.asarray(state + states[tuple(other + step)] - states[tuple(other)])
    return state
