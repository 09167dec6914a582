"""A sweep table as arrays over currents and distances, and its reciprocity."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from femfit.core.arrays import FloatArray
from femfit.fit.rows import FitRows

FEWEST_DISTANCES = 5


@dataclass(frozen=True, eq=False)
class SweepGrid:
    """A full grid of m currents and n distances, arrays of shape (m, n).

    Parameters
    ----------
    force_scale : array
        What an error is a part of: the force, but for its passages through zero.
    """

    currents: FloatArray
    distances: FloatArray
    force: FloatArray
    force_error: FloatArray
    force_scale: FloatArray
    flux_linkage: FloatArray | None


@dataclass(frozen=True, eq=False)
class Reciprocity:
    """Force per ampere of the table in N/A, from dF/di and from -d(flux linkage)/dd, at the middles of the currents."""

    currents: FloatArray
    distances: FloatArray
    from_force: FloatArray
    from_flux: FloatArray

    @property
    def largest_difference(self) -> float:
        """Over the largest k_m; the outermost distances, where a spline has one neighbour only, left out."""
        inner = slice(1, -1)
        difference = self.from_flux[:, inner] - self.from_force[:, inner]
        return float(np.max(np.abs(difference)) / np.max(np.abs(self.from_force)))


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


def reciprocity(grid: SweepGrid) -> Reciprocity | None:
    """Compare dF/di with -d(flux linkage)/dd, both averaged over each pair of adjacent currents.

    Over a pair, the mean of dF/di is the difference quotient; the mean flux linkage is taken by the trapezoidal rule,
    which is exact in a linear actuator, and differentiated along the distance by a cubic spline.

    Returns
    -------
    Reciprocity or None
        None without flux linkage, with one current, or with too few distances for a derivative.
    """
    if grid.flux_linkage is None or len(grid.currents) < 2 or len(grid.distances) < FEWEST_DISTANCES:
        return None
    mean_flux = 0.5 * (grid.flux_linkage[1:] + grid.flux_linkage[:-1])
    return Reciprocity(
        currents=0.5 * (grid.currents[1:] + grid.currents[:-1]),
        distances=grid.distances,
        from_force=np.diff(grid.force, axis=0) / np.diff(grid.currents)[:, None],
        from_flux=-np.asarray(CubicSpline(grid.distances, mean_flux, axis=1)(grid.distances, 1)),
    )
