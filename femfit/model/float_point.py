"""Force, motional constants and inductances at one point, as cheaply as one point allows."""

from collections.abc import Callable

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.magnetics import CoenergySpline, Magnetics

PointMagnetics = Callable[[float, FloatArray], tuple[float, FloatArray, FloatArray]]
"""(distance in m, currents in A, shape (n,)) -> F in N, dF/di in N/A, shape (n,), and L in H, shape (n, n)."""


def point_magnetics(magnetics: Magnetics) -> PointMagnetics:
    """Force, motional constants and inductances of a co-energy; in floats where there is one current, or none."""
    if type(magnetics) is not CoenergySpline:

        def by_arrays(distance: float, currents: FloatArray) -> tuple[float, FloatArray, FloatArray]:
            state = magnetics.state_of_circuits(np.array([distance]), currents[None])
            return float(state.force[0]), state.motional_constant[0], state.inductance[0]

        return by_arrays

    place = magnetics.coordinate.in_floats()
    derivatives = magnetics.spline.in_floats(((1, 0), (1, 1), (0, 2)))

    def in_floats(distance: float, currents: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        u, (per_metre,) = place([distance])
        if not currents.size:
            ((slope, _, _),) = derivatives(u, [0.0])
            return per_metre * slope, currents, np.zeros((0, 0))
        ((slope, mixed, inductance),) = derivatives(u, [float(currents[0])])
        return per_metre * slope, np.array([per_metre * mixed]), np.array([[inductance]])

    return in_floats
