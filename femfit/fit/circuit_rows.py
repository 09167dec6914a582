"""Rows of a sweep of several circuits, and the knots of the distance that fit them."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.fit.constants import U_DEGREE
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


def distance_knots(coordinate: DistanceCoordinate, distances: FloatArray, cells: int) -> FloatArray:
    """Clamped knots of equal cells in the coordinate over ascending distances in m."""
    ends = np.sort(coordinate.of(distances[[0, -1]]))
    breaks = np.linspace(ends[0], ends[1], cells + 1)
    return np.concatenate([np.repeat(breaks[0], U_DEGREE), breaks, np.repeat(breaks[-1], U_DEGREE)])
