"""Jacobians by central differences."""

from collections.abc import Callable

import numpy as np

from femfit.core.arrays import FloatArray


def central_differences(
    function: Callable[[FloatArray], FloatArray], states: FloatArray, scale: FloatArray | None = None
) -> FloatArray:
    """Jacobian of a batched function by central differences.

    Parameters
    ----------
    function : callable
        Points (2 n N, n) -> values (2 n N, k); called once.
    states : array, shape (N, n)
        Where.
    scale : array, shape (n,), or None
        Size of each state over which the function changes, so that a state near 0 has no step near 0. None: the state's
        own size, and 1 where it is 0.

    Returns
    -------
    array, shape (N, k, n)
        With steps of eps^(1/3) relative to the larger of state and scale, whose rounding and truncation errors balance.
    """
    count, order = states.shape
    size = np.where(states == 0.0, 1.0, np.abs(states)) if scale is None else np.maximum(np.abs(states), scale)
    width = np.cbrt(np.finfo(states.dtype).eps) * size
    points = np.broadcast_to(states, (2, order, count, order)).copy()
    for k in range(order):
        points[0, k, :, k] += width[:, k]
        points[1, k, :, k] -= width[:, k]
    values = function(points.reshape(-1, order)).reshape(2, order, count, -1)
    exact_width = np.stack([points[0, k, :, k] - points[1, k, :, k] for k in range(order)])
    return np.moveaxis((values[0] - values[1]) / exact_width[:, :, None], 0, -1)
