"""Partial derivatives of a co-energy at points."""

import numpy as np
from casadi import SX

from femfit.core.graph import GraphFunction, building
from femfit.model import bspline


def partials(coenergy, distance, current, orders):
    """Of W'(d, i), in orders (in d, in i), or of W'(d, i, h), in orders (in d, in i, in h) at no test current.

    Each has the shape that distances and the only circuit's currents have together.
    """
    size = len(orders[0])
    with building():
        at = SX.sym("at", size)
        function = GraphFunction([at], bspline.partials(SX(coenergy(*(at[k] for k in range(size)))), at, orders))
    d, i = np.broadcast_arrays(np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64))
    points = np.stack([d.ravel(), i.ravel(), np.zeros(d.size)][:size])
    return [value.reshape(d.shape) for value in function(points)]
