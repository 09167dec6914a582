"""The scale on which distances are compared: steps along it change a magnetic force about evenly."""

import numpy as np

from femfit.core.arrays import FloatArray

_NEAR = 0.1
"""Part of the stroke over which a body that passes the face is near to it; chosen."""


def even_scale(distance: FloatArray) -> FloatArray:
    """The logarithm of distances, counted from before the nearest where a body passes the face.

    Examples
    --------
    >>> even_scale(np.array([1e-3, 1e-2])).round(2).tolist()
    [-6.91, -4.61]
    >>> even_scale(np.array([-1e-3, 9e-3])).round(2).tolist()
    [-6.91, -4.51]
    """
    known = distance[np.isfinite(distance)]
    if not len(known) or known.min() > 0.0:
        return np.log(distance)
    stroke = float(np.ptp(known)) or 1.0
    return np.log(distance - float(known.min()) + _NEAR * stroke)
