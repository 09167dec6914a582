"""The field at the Hall element: coil part and magnet part, from the sweep.

B(d, i) = sum_n i^n S_n(d_0 / (d + s)): S_0 is the magnet's part (the paper's MH), the higher powers the coil's part
(the paper's CH), whose slight dependence on distance is the magnet's own permeability. In a linear actuator n <= 1.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14) to (16) and Figure 11.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.bspline import TensorSpline


@dataclass(frozen=True, eq=False)
class HallField:
    """B_z(d, i) at the Hall element.

    Parameters
    ----------
    reference_distance_m : float
        d_0.
    spline : TensorSpline
        In (d_0 / (d + s), i), in T; a polynomial in the current is a spline with one cell.
    distance_shift_m : float
        s >= 0, as in :class:`femfit.model.magnetics.CoenergySpline`.
    """

    reference_distance_m: float
    spline: TensorSpline
    distance_shift_m: float = 0.0

    def field(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """B_z in T at distances (m) and currents (A) that broadcast."""
        distance, current = np.broadcast_arrays(
            np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64)
        )
        u = self.reference_distance_m / (distance.ravel() + self.distance_shift_m)
        return self.spline.derivatives(u, current.ravel(), ((0, 0),))[0].reshape(distance.shape)

    def derivatives(self, distance: FloatArray, current: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """B_z in T, dB_z/dd in T/m and dB_z/di in T/A.

        Parameters
        ----------
        distance, current : array
            Points; broadcast against each other.

        Returns
        -------
        tuple of three arrays
            In the broadcast shape.
        """
        distance, current = np.broadcast_arrays(
            np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64)
        )
        shifted = distance.ravel() + self.distance_shift_m
        u = self.reference_distance_m / shifted
        value, in_u, in_i = self.spline.derivatives(u, current.ravel(), ((0, 0), (1, 0), (0, 1)))
        shape = distance.shape
        return value.reshape(shape), (-u / shifted * in_u).reshape(shape), in_i.reshape(shape)
