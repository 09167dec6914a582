"""Partial derivatives of a co-energy at points."""

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import GraphFunction, building


def partials(coenergy, distance, current, orders):
    """Of W'(d, i), in orders (in d, in i), or of W'(d, i, h), in orders (in d, in i, in h) at no test current.

    Each has the shape that distances and the only circuit's currents have together.
    """

    def derivative(value, at, order):
        for variable in np.repeat(np.arange(len(order)), order).tolist():
            value = ca.gradient(value, at[variable])
        return value

    size = len(orders[0])
    with building():
        at = SX.sym("at", size)
        value = SX(coenergy(*(at[k] for k in range(size))))
        function = GraphFunction([at], ca.vertcat(*(derivative(value, at, order) for order in orders)))
    d, i = np.broadcast_arrays(np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64))
    points = np.stack([d.ravel(), i.ravel(), np.zeros(d.size)][:size])
    return [value.reshape(d.shape) for value in function(points)]
