"""How many B-splines a co-energy takes, and where their knots lie: what held-out rows of the sweep ask for."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain, groupby
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np

from femfit.core.errors import FitError
from femfit.core.numerics import ROUNDING, FloatArray, ranked
from femfit.core.text import counted
from femfit.fit import constants
from femfit.fit.basis import CoenergyBasis, CurrentSplines, clamped_knots
from femfit.fit.coenergy_system import CoenergySystem
from femfit.fit.rows import FitRows
from femfit.model.bspline import DistanceCoordinate


def choose_basis(rows: FitRows, system: CoenergySystem) -> tuple[CoenergyBasis, float]:
    """The smallest basis below its target on held-out rows, or else the smallest that is nearly the best.

    Distance and current are searched in turn, each with what was chosen for the other. The error is that of
    :class:`femfit.fit.coenergy.CoenergyFit`; FitError if there are too few currents or distances.
    """
    count = constants.FEWEST_CURRENTS if rows.without_current else len(rows.currents)
    spare = 2 if rows.flux_linkage is None else 0  # flux linkage gives W' itself beside its slope
    fewest = constants.U_DEGREE + 1 + spare
    if count < constants.FEWEST_CURRENTS or len(rows.distances) < fewest:
        raise FitError(
            f"A co-energy needs at least {constants.FEWEST_CURRENTS} currents and {fewest} distances; instead received "
            f"{counted(count, 'current')} and {counted(len(rows.distances), 'distance')}. Sweep more "
            + ("currents." if count < constants.FEWEST_CURRENTS else "distances, or fit a law.")
        )
    counts = [n for n in constants.DISTANCE_CELLS if n <= constants.MOST_CELLS or not rows.saturates]
    in_current = _current_trials(rows)
    # A bend that is not resolved hides what the distances show
    start = in_current[-1 if rows.saturates else 0]
    in_distance = [*chain(*splines_along(rows.distances, counts, start, spare, breaks="following"))]
    basis, error, size_of = in_distance[0], np.inf, attrgetter("size")
    nearly = constants.NEARLY_BEST_BENT if rows.saturates else constants.NEARLY_BEST
    for _ in range(constants.ROUNDS):
        before = basis.functions
        for places, currents in ((in_distance, [basis.functions]), ([], in_current)):
            trials = [replace(place, functions=functions) for place in places or [basis] for functions in currents]
            alike = (list(group) for _, group in groupby(sorted(trials, key=size_of), size_of))
            basis, error = smallest(alike, system.held_out_errors, nearly=nearly)
            if error < constants.HELD_OUT_TARGET:
                return basis, error
        if basis.functions is before:  # the distance was searched with these
            break
    if not np.isfinite(error):
        raise FitError(
            "The rows do not determine a co-energy: too many currents are missing at too many distances. Sweep every "
            "current at every distance, or fit a law."
        )
    return basis, error


Tried = TypeVar("Tried")


def smallest(
    groups: Iterable[Sequence[Tried]],
    errors_of: Callable[[Tried], Any],
    target: float = constants.HELD_OUT_TARGET,
    nearly: float = constants.NEARLY_BEST,
) -> tuple[Tried, float]:
    """The first below its target, or else the first that is nearly the best, and its largest error.

    Parameters
    ----------
    groups : iterable of sequence
        What is tried, in groups of one size, the smallest first; of one group the best comes first.
    errors_of : callable
        Errors on rows left out, as (2,) of force and flux linkage, or one: noise of the one must not hide what the
        other shows.
    """
    scored: list[tuple[Any, Tried]] = []
    for alike in groups:
        tried = ranked([(errors_of(trial), trial) for trial in alike], lambda pair: -float(np.max(pair[0])))
        errors, best = tried[0]
        if np.max(errors) < target:
            return best, float(np.max(errors))
        # A column that is good enough must not ask for more
        scored += [(np.maximum(errors, target), trial) for errors, trial in tried]
    least = np.min([errors for errors, _ in scored], axis=0)
    if not np.all(np.isfinite(least)):
        return scored[0][1], np.inf
    allowed = max(nearly, min(float(np.max(errors / least)) for errors, _ in scored))
    errors, best = next(pair for pair in scored if np.max(pair[0] / least) <= (1.0 + ROUNDING) * allowed)
    return best, float(np.max(errors))


def _current_trials(rows: FitRows) -> list[CurrentSplines]:
    """Splines of the current: a held-out fold must leave more data than functions.

    Without any current W' depends on the distance alone: one function of degree zero.

    Where the inductance bends, breaks also lie at the currents and at the thirds between them, at each current if these
    are many, or evenly fewer. Each current gives three numbers of W'(i): its slope in the distance by the force, the
    flux linkage and the inductance. From one current to the next a cubic spline meets those of both ends with three
    cells, not with two; a number that cuts some intervals once and others twice misses more than either.
    """
    if rows.without_current:
        return [CurrentSplines((np.array([0.0, 1.0]),), (0,))]
    count, last = len(rows.currents), len(rows.currents) - 1
    forms = [(2, 1)] if count >= constants.FEWEST_CURRENTS else []
    forms += [(degree, n) for degree in (3, 4) for n in constants.CELLS_IN_CURRENT if degree + n + 2 <= count]
    even = [(degree, np.linspace(rows.currents[0], rows.currents[-1], n + 1)) for degree, n in forms]
    following = []
    if rows.saturates:
        thirds = np.interp(np.arange(3 * last + 1) / 3.0, np.arange(last + 1), rows.currents)
        finest = 3 * last if 3 * last <= constants.MOST_BENT_CELLS else min(last, constants.MOST_BENT_CELLS)
        for n in sorted({min(n, finest) for n in (*constants.BENT_CELLS, finest)}):
            breaks = thirds[np.rint(np.linspace(0.0, 3.0 * last, n + 1)).astype(int)]
            following.append((constants.SMOOTHED_DEGREE, breaks))
    return [CurrentSplines((clamped_knots(breaks, degree),), (degree,)) for degree, breaks in even + following]


def splines_along(
    distances: FloatArray,
    counts: Sequence[int],
    functions: CurrentSplines,
    spare: int = 0,
    *,
    degree: int = constants.U_DEGREE,
    breaks: str = "even",
) -> Iterator[list[CoenergyBasis]]:
    """Splines over ascending distances in m, those of as many cells together; ``spare`` distances more than functions.

    Breaks lie evenly in the coordinate, or, ``following``, also where the distances do: these leave data in every cell.
    ``geometric`` ones are even in its logarithm where it is inverse. The coordinates are inverse ones with several
    shifts, the plain distance and, with even breaks alone, those between two gaps.
    """
    nearest, stroke = float(distances[0]), float(np.ptp(distances))
    shifts = [share * stroke for share in constants.SHIFTS]
    inverse = [s for s in shifts if nearest > 0.0 or nearest + s >= constants.CLOSEST * stroke]
    coordinates = [DistanceCoordinate(nearest + s, s) for s in inverse]
    coordinates.append(DistanceCoordinate(stroke, kind="distance"))
    if breaks == "even":
        middle = float(distances[[0, -1]].mean())
        coordinates += [
            DistanceCoordinate(middle, kind="two_gaps", stretch_m=share * stroke) for share in constants.TWO_GAPS
        ]
    for count in counts:
        if degree + count + spare > len(distances):
            return
        alike = []
        for coordinate in coordinates:
            at_rows = np.sort(coordinate.of(np.quantile(distances, np.linspace(0.0, 1.0, count + 1))))
            spaced = np.geomspace if breaks == "geometric" and coordinate.inverse else np.linspace
            even = spaced(at_rows[0], at_rows[-1], count + 1)
            places = [even, at_rows] if breaks == "following" and count > 1 else [even]
            alike += [CoenergyBasis(coordinate, clamped_knots(u, degree), functions, degree) for u in places]
        yield alike


def best_along_distance(system: CoenergySystem, functions: CurrentSplines) -> CoenergyBasis:
    """Functions of several currents with the splines of the distance that miss least with distances left out.

    Raises
    ------
    FitError
        If there are fewer distances than one cell needs.
    """
    distances = np.unique(system.distance)
    if len(distances) < constants.U_DEGREE + 1:
        raise FitError(
            f"Several circuits need a sweep of at least {constants.U_DEGREE + 1} distances; instead received "
            f"{len(distances)}. Sweep more distances."
        )
    groups = splines_along(distances, constants.CIRCUIT_CELLS, functions)
    return smallest(groups, lambda basis: system.held_out_errors(basis).max())[0]
