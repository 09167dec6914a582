"""How many B-splines a co-energy takes, and where their knots lie: what held-out rows of the sweep ask for."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np

from femfit.core.errors import FitError
from femfit.core.numerics import ROUNDING, FloatArray, first_best
from femfit.core.text import counted
from femfit.fit.basis import CoenergyBasis, CurrentFunctions, CurrentSplines, clamped_knots
from femfit.fit.coenergy_system import CoenergySystem
from femfit.fit.constants import (
    BENT_CELLS,
    CELLS_IN_CURRENT,
    CIRCUIT_CELLS,
    CLOSEST,
    FEWEST_CURRENTS,
    HELD_OUT_TARGET,
    MOST_BENT_CELLS,
    MOST_CELLS,
    NEARLY_BEST,
    NEARLY_BEST_BENT,
    ROUNDS,
    SHIFTS,
    SMOOTHED_DEGREE,
    TWO_GAPS,
    U_DEGREE,
)
from femfit.fit.rows import FitRows
from femfit.model.bspline import DistanceCoordinate


def choose_basis(system: CoenergySystem) -> tuple[CoenergyBasis, float]:
    """The smallest basis below its target on held-out rows, or else the smallest that is nearly the best.

    Distance and current are searched in turn, each with what was chosen for the other. The error is that of
    :class:`femfit.fit.coenergy.CoenergyFit`; FitError if there are too few currents or distances.
    """
    rows = system.rows
    currents = FEWEST_CURRENTS if rows.without_current else len(rows.currents)
    check_grid(currents, len(rows.distances), _fewest_distances(rows))
    in_distance, in_current = distance_trials(rows), _current_trials(rows)
    start = in_current[
        0 if rows.inductance is None else -1
    ]  # a bend that is not resolved hides what the distances show
    basis, error = CoenergyBasis(**in_distance[0], functions=start), np.inf
    for _ in range(ROUNDS):
        before = basis.functions
        for trials in (in_distance, [{"functions": functions} for functions in in_current]):
            basis, error = _best([replace(basis, **trial) for trial in trials], system)
            if error < HELD_OUT_TARGET:
                return basis, error
        if basis.functions is before:  # the distance was searched with these
            break
    if not np.isfinite(error):
        raise FitError(
            "The rows do not determine a co-energy: too many currents are missing at too many distances. Sweep every "
            "current at every distance, or fit a law."
        )
    return basis, error


def _best(bases: Sequence[CoenergyBasis], system: CoenergySystem) -> tuple[CoenergyBasis, float]:
    """The choice among bases, force and flux linkage apart: noise of the one must not hide what the other shows."""
    scored: list[tuple[FloatArray, CoenergyBasis]] = []
    size_of = attrgetter("size")
    for _, alike in groupby(sorted(bases, key=size_of), key=size_of):
        tried = [(system.held_out_errors(basis), basis) for basis in alike]
        errors, basis = tried[first_best([-float(np.max(errors)) for errors, _ in tried])]
        if np.max(errors) < HELD_OUT_TARGET:
            return basis, float(np.max(errors))
        # A column that is good enough must not ask for more.
        scored += [(np.maximum(trial, HELD_OUT_TARGET), basis) for trial, basis in tried]
    best = np.min([errors for errors, _ in scored], axis=0)
    if not np.all(np.isfinite(best)):
        return scored[0][1], np.inf
    nearly = NEARLY_BEST if system.rows.inductance is None else NEARLY_BEST_BENT
    allowed = max(nearly, min(float(np.max(errors / best)) for errors, _ in scored))
    errors, basis = next(pair for pair in scored if np.max(pair[0] / best) <= (1.0 + ROUNDING) * allowed)
    return basis, float(np.max(errors))


def check_grid(currents: int, distances: int, fewest_distances: int = U_DEGREE + 1) -> None:
    """Refuse a grid with fewer currents or distances than any co-energy needs, by a FitError."""
    if currents < FEWEST_CURRENTS or distances < fewest_distances:
        raise FitError(
            f"A co-energy needs at least {FEWEST_CURRENTS} currents and {fewest_distances} distances; instead received "
            f"{counted(currents, 'current')} and {counted(distances, 'distance')}. Sweep more "
            + ("currents." if currents < FEWEST_CURRENTS else "distances, or fit a law.")
        )


def _fewest_distances(rows: FitRows, cells: int = 1) -> int:
    """Distances that so many cells need; flux linkage gives W' itself beside its slope, so that fewer will do."""
    return U_DEGREE + cells + (2 if rows.flux_linkage is None else 0)


def _current_trials(rows: FitRows) -> list[CurrentSplines]:
    """Splines of the current: a held-out fold must leave more data than functions.

    Without any current W' depends on the distance alone: one function of degree zero.
    """
    if rows.without_current:
        return [CurrentSplines((np.array([0.0, 1.0]),), (0,))]
    count = len(rows.currents)
    forms = [(2, 1)] if count >= FEWEST_CURRENTS else []
    forms += [(degree, n) for degree in (3, 4) for n in CELLS_IN_CURRENT if degree + n + 2 <= count]
    even = [(degree, np.linspace(rows.currents[0], rows.currents[-1], n + 1)) for degree, n in forms]
    following = [(SMOOTHED_DEGREE, breaks) for breaks in _bent_breaks(rows)]
    return [CurrentSplines((clamped_knots(breaks, degree),), (degree,)) for degree, breaks in even + following]


def _bent_breaks(rows: FitRows) -> list[FloatArray]:
    """Breaks at the currents and at the thirds between them, at each current if these are many, or evenly fewer.

    Each current gives three numbers of W'(i): its slope in the distance by the force, the flux linkage and the
    inductance. From one current to the next a cubic spline meets those of both ends with three cells, not with two;
    a number that cuts some intervals once and others twice misses more than either.
    """
    if rows.inductance is None:
        return []
    last = len(rows.currents) - 1
    thirds = np.interp(np.arange(3 * last + 1) / 3.0, np.arange(last + 1), rows.currents)
    finest = 3 * last if 3 * last <= MOST_BENT_CELLS else min(last, MOST_BENT_CELLS)
    counts = sorted({min(n, finest) for n in (*BENT_CELLS, finest)})
    return [thirds[np.rint(np.linspace(0.0, 3.0 * last, n + 1)).astype(int)] for n in counts]


def distance_trials(rows: FitRows) -> list[dict[str, Any]]:
    """Coordinates of the distance, and knots in them."""
    trials = []
    for coordinate in distance_coordinates(rows.distances):
        d = rows.distances
        for n in (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20):
            if _fewest_distances(rows, n) > len(d) or (rows.inductance is not None and n > MOST_CELLS):
                break
            # Breaks that follow the rows leave data in every cell, where uniform ones would not.
            following = np.sort(coordinate.of(np.quantile(d, np.linspace(0.0, 1.0, n + 1))))
            even = np.linspace(following[0], following[-1], n + 1)
            trials += [
                {"coordinate": coordinate, "u_knots": clamped_knots(u, U_DEGREE)}
                for u in ((even,) if n == 1 else (even, following))
            ]
    return trials


def distance_coordinates(distances: FloatArray) -> list[DistanceCoordinate]:
    """The coordinates that are tried for ascending distances in m: inverse ones with several shifts, and the plain."""
    stroke = float(np.ptp(distances))
    nearest = float(distances[0])
    shifts = [share * stroke for share in SHIFTS]
    inverse = [s for s in shifts if nearest > 0.0 or nearest + s >= CLOSEST * stroke]
    return [*(DistanceCoordinate(nearest + s, s) for s in inverse), DistanceCoordinate(stroke, kind="distance")]


Along = tuple[DistanceCoordinate, FloatArray]
"""A coordinate of the distance, and the knots in it."""


def choose_along_distance(
    distances: FloatArray, held_out: Callable[[DistanceCoordinate, FloatArray], float]
) -> tuple[Along, float]:
    """The fewest cells below the target on distances left out, or the fewest that are nearly the best, and the error.

    Parameters
    ----------
    distances : array, shape (n,)
        Ascending, in m.
    held_out : callable
        Coordinate and knots -> rms error on distances left out.

    Raises
    ------
    FitError
        If there are fewer distances than one cell needs.
    """
    if len(distances) < U_DEGREE + 1:
        raise FitError(
            f"Several circuits need a sweep of at least {U_DEGREE + 1} distances; instead received {len(distances)}. "
            "Sweep more distances."
        )
    middle, width = float(distances[[0, -1]].mean()), float(np.ptp(distances))
    between = [DistanceCoordinate(middle, kind="two_gaps", stretch_m=share * width) for share in TWO_GAPS]
    coordinates = [*distance_coordinates(distances), *between]
    scored: list[tuple[float, Along]] = []
    for cells in CIRCUIT_CELLS:
        if U_DEGREE + cells > len(distances):
            break
        alike: list[tuple[float, Along]] = []
        for coordinate in coordinates:
            ends = np.sort(coordinate.of(distances[[0, -1]]))
            knots = clamped_knots(np.linspace(ends[0], ends[1], cells + 1), U_DEGREE)
            alike.append((held_out(coordinate, knots), (coordinate, knots)))
        error, along = min(alike, key=lambda pair: pair[0])
        if error < HELD_OUT_TARGET:
            return along, error
        scored += sorted(alike, key=lambda pair: pair[0])
    least = min(error for error, _ in scored)
    error, along = next(pair for pair in scored if pair[0] <= NEARLY_BEST * least)
    return along, error


def best_along_distance(system: CoenergySystem, functions: CurrentFunctions) -> CoenergyBasis:
    """Functions of several currents with the splines of the distance that miss least with distances left out."""

    def held_out(coordinate: DistanceCoordinate, knots: FloatArray) -> float:
        return float(system.held_out_errors(CoenergyBasis(coordinate, knots, functions)).max())

    along, _ = choose_along_distance(system.rows.distances, held_out)
    return CoenergyBasis(*along, functions)
