"""From the drawn half section to the full one, and its corners."""

import numpy as np
import shapely

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator

Outline = tuple[tuple[float, float], ...]


def full_section(vertices: Outline, shift: float = 0.0) -> tuple[FloatArray, ...]:
    """Outlines of a part in the full section.

    Parameters
    ----------
    vertices : tuple of (float, float)
        Corners (r, z) of the half section, r >= 0, in m.
    shift : float
        Along z, in m.

    Returns
    -------
    tuple of array, shape (n, 2)
        Corners (x, z): one outline for a part on the axis, a left and a right one for a ring.
    """
    half = np.asarray(vertices, dtype=np.float64) + np.array([0.0, shift])
    both = shapely.union_all([shapely.Polygon(half), shapely.Polygon(half * np.array([-1.0, 1.0]))])
    parts = getattr(both, "geoms", [both])
    return tuple(np.asarray(part.exterior.coords)[:-1] for part in sorted(parts, key=lambda p: float(p.centroid.x)))


def mirrored(radius: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A quantity that is even in r, on the full section.

    Parameters
    ----------
    radius : array, shape (n,)
        Ascending from 0, in m.
    values : array, shape (m, n)
        On the half section.

    Returns
    -------
    x : array, shape (2 n - 1,)
        In m.
    values : array, shape (m, 2 n - 1)
        On the full section.
    """
    return np.concatenate([-radius[:0:-1], radius]), np.concatenate([values[:, :0:-1], values], axis=1)


def standing_corners(actuator: Actuator) -> FloatArray:
    """Corners (r, z) of core and winding in m, shape (n, 2).

    Returns
    -------
    array, shape (n, 2)
        In m.
    """
    outlines = [region.vertices_m for region in actuator.fixed]
    return np.concatenate([np.asarray(vertices) for vertices in (*outlines, actuator.coil.vertices_m)])


def moving_corners(actuator: Actuator, distance: float) -> FloatArray:
    """Corners (r, z) of the moving part at a distance in m, shape (n, 2).

    Returns
    -------
    array, shape (n, 2)
        In m.
    """
    corners = np.concatenate([np.asarray(region.vertices_m) for region in actuator.moving.regions])
    return np.asarray(corners + np.array([0.0, distance]))
