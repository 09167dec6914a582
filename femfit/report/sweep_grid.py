"""A sweep table as arrays over currents and distances, and its reciprocity."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from femfit.core.arrays import FloatArray
from femfit.fit.rows import FitRows

FEWEST_DISTANCES = 5


@dataclass(frozen=True, eq=False)
class SweepGrid:
    """A full grid of m currents and n distances, arrays of shape (m, n)."""

    currents: FloatArray
    distances: FloatArray
    force: FloatArray
    force_error: FloatArray
    force_scale: FloatArray  # What an error is a part of: the force, but for its passages through zero
    flux_linkage: FloatArray | None

    @property
    def is_plane(self) -> bool:
        """Whether a map can show it: a pair of magnets has one current, none."""
        return len(self.currents) > 1 and len(self.distances) > 1


def sweep_grid(rows: FitRows) -> SweepGrid | None:
    """Arrange rows on their grid."""
    currents, distances = rows.currents, rows.distances
    shape = (len(currents), len(distances))
    if len(rows.force) != shape[0] * shape[1]:
        return None
    order = np.lexsort((rows.distance, rows.current))
    flux = None if rows.flux_linkage is None else rows.flux_linkage[order].reshape(shape)
    columns = (rows.force, rows.force_error, rows.force_scale)
    force, error, scale = (values[order].reshape(shape) for values in columns)
    return SweepGrid(currents, distances, force, error, scale, flux)


def reciprocity(grid: SweepGrid) -> float | None:
    """Largest difference of dF/di and -d(flux linkage)/dd over the largest dF/di; None where the table cannot tell.

    Over a pair of adjacent currents the mean of dF/di is the difference quotient; the mean flux linkage is taken by the
    trapezoidal rule, which is exact in a linear actuator, and differentiated along the distance by a cubic spline,
    whose ends, with one neighbour only, are left out.
    """
    if grid.flux_linkage is None or len(grid.currents) < 2 or len(grid.distances) < FEWEST_DISTANCES:
        return None
    mean_flux = 0.5 * (grid.flux_linkage[1:] + grid.flux_linkage[:-1])
    from_force = (np.diff(grid.force, axis=0) / np.diff(grid.currents)[:, None])[:, 1:-1]
    from_flux = -CubicSpline(grid.distances, mean_flux, axis=1)(grid.distances[1:-1], 1)
    return float(np.max(np.abs(from_flux - from_force)) / np.max(np.abs(from_force)))
