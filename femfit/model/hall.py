"""The field at the Hall element: coil part and magnet part, from the sweep.

B(d, i) = sum_n i^n S_n(u(d)) in a coordinate of the distance: S_0 is the magnet's part, the higher powers the coil's
part, whose slight dependence on distance is the magnet's own permeability. In a linear actuator n <= 1.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.bspline import TensorSpline
from femfit.model.coordinate import DistanceCoordinate


class HallField(ABC):
    """B_z(d, i) at the Hall element; all arguments broadcast, distances in m, currents in A."""

    @abstractmethod
    def _partials(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
        """Partial derivatives of B_z at flat arrays, for orders (in d, in i)."""

    def partials(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
        """Partial derivatives of the field, of orders (in d, in i), in T / m^a / A^b."""
        if np.ndim(distance) == 1 and np.shape(distance) == np.shape(current):  # what plant and filters ask for
            return self._partials(np.asarray(distance, np.float64), np.asarray(current, np.float64), orders)
        distance, current = np.broadcast_arrays(
            np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64)
        )
        return [value.reshape(distance.shape) for value in self._partials(distance.ravel(), current.ravel(), orders)]

    def field(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """B_z in T at distances (m) and currents (A) that broadcast."""
        return self.partials(distance, current, ((0, 0),))[0]

    def derivatives(self, distance: FloatArray, current: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """B_z in T, dB_z/dd in T/m and dB_z/di in T/A."""
        value, in_d, in_i = self.partials(distance, current, ((0, 0), (1, 0), (0, 1)))
        return value, in_d, in_i


@dataclass(frozen=True, eq=False)
class HallSpline(HallField):
    """B_z(d, i) at the Hall element as a tensor B-spline."""

    coordinate: DistanceCoordinate
    spline: TensorSpline  # In (u, i), in T; a polynomial in the current is a spline with one cell

    def _partials(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
        return self.coordinate.partial_derivatives(self.spline, distance, current, orders)
