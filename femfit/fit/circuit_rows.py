"""Rows of a sweep of several circuits, and the splines of the distance that fit them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import FitError
from femfit.fit.coenergy_choice import distance_coordinates
from femfit.fit.constants import (
    CIRCUIT_CELLS,
    FEWEST_CURRENTS,
    HELD_OUT_TARGET,
    NEARLY_BEST,
    SMALL_CIRCUIT_FORCE,
    SMALL_FLUX,
    TWO_GAPS,
    U_DEGREE,
)
from femfit.fit.splines import clamped_knots
from femfit.model.coordinate import DistanceCoordinate


@dataclass(frozen=True, eq=False)
class CircuitRows:
    """Rows of a sweep of n circuits, in SI units."""

    names: tuple[str, ...]
    distance: FloatArray  # (rows,)
    currents: FloatArray  # (rows, n)
    force: FloatArray
    flux_linkage: FloatArray  # (rows, n)
    force_error: FloatArray  # Estimated error of the force; zero where the table gives none
    # Slopes of the flux linkages over the currents in H, (rows, n, n); None where the table does not give all
    inductance: FloatArray | None = None
    magnet: bool = True  # Without one W' is even: no force, and no flux linkage, where no current flows

    @property
    def force_scale(self) -> FloatArray:
        """What an error of each row's force is a part of: the force, or a part of the largest one; (rows,)."""
        force = np.abs(self.force)
        return np.asarray(np.maximum(force, SMALL_CIRCUIT_FORCE * np.max(force)))

    @property
    def relative_flux_scale(self) -> FloatArray:
        """The same of each flux linkage; (rows, n)."""
        flux = np.abs(self.flux_linkage)
        return np.asarray(np.maximum(flux, SMALL_FLUX * flux.max(axis=0)))

    @property
    def flux_scale(self) -> FloatArray:
        """Rms of each flux linkage in Wb, so that a winding with few turns counts as much as one with many; (n,)."""
        return np.asarray(np.sqrt(np.mean(self.flux_linkage**2, axis=0)))

    def worst_flux_share(self, missed: FloatArray) -> float:
        """The largest of the circuits' rms errors of shape (rows, n), each over its flux linkage's own rms."""
        return float(np.max(np.sqrt(np.mean(missed**2, axis=0)) / self.flux_scale))

    @property
    def distances(self) -> FloatArray:
        """Distinct distances, ascending."""
        return np.unique(self.distance)

    @property
    def grid_points(self) -> int:
        """Points of the grid of all distances and currents, of which a row may be missing."""
        return len(self.distances) * int(np.prod([len(np.unique(column)) for column in self.currents.T]))


def require_currents(rows: CircuitRows, why: str) -> None:
    """Refuse two currents of a circuit whose iron bends: a quadratic form would meet both, however it bends."""
    few = [
        name
        for name, column in zip(rows.names, rows.currents.T, strict=True)
        if len(np.unique(column)) < FEWEST_CURRENTS
    ]
    if few:
        raise FitError(
            f"{why}, and each circuit then needs {FEWEST_CURRENTS} currents or more to show how it bends; "
            f"{' and '.join(few)} {'has' if len(few) == 1 else 'have'} fewer. Sweep more of them, together with all of "
            "the others'."
        )


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
    between = [DistanceCoordinate(middle, inverse=False, stretch_m=share * width) for share in TWO_GAPS]
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
