"""What a fixed point or a winding without current has of the field, with any circuits: a tensor B-spline.

f(d, i_1..i_n) = sum of c_(a b1..bn) N_a(u(d)) N_b1(i_1) .. N_bn(i_n): the flux density at a Hall element, or the flux
linkage of a pickup coil. A device that does not saturate has lines in the currents. Outside of the knots the
polynomials at their ends are continued.

Distances have the shape (...), currents (..., n) in the circuits' order, or (...) where there is one circuit or none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError
from femfit.model.bspline import basis_matrix
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.hall import HallField
from femfit.model.several_magnetics import of_one_circuit


@dataclass(frozen=True, eq=False)
class SensedField(HallField):
    """The spline of the module's head."""

    coordinate: DistanceCoordinate
    u_knots: FloatArray
    u_degree: int
    current_knots_A: tuple[FloatArray, ...]  # Of each circuit
    current_degrees: tuple[int, ...]
    coefficients: FloatArray  # Shape (functions of u, functions of i_1, ..)

    def field(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """The value at distances and currents, shape (...)."""
        return self._values(distance, current, slopes=False)[0]

    def derivatives(self, distance: FloatArray, current: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value, slope along the distance, both (...), and slopes along the currents, in the currents' shape."""
        value, in_distance, *in_currents = self._values(distance, current, slopes=True)
        if len(in_currents) == 1:
            return value, in_distance, in_currents[0]
        empty = np.zeros((*value.shape, 0))
        return value, in_distance, np.stack(in_currents, axis=-1) if in_currents else empty

    def scaled(self, magnets: float, currents: Sequence[float]) -> "SensedField":
        """The field with magnets and currents scaled: s_0 f(d, i_1 s_1 / s_0, ..), of the first degree in both."""
        scales = [one / magnets for one in currents]
        knots = tuple(one / s for one, s in zip(self.current_knots_A, scales, strict=False))  # or of no current
        return replace(self, current_knots_A=knots, coefficients=magnets * self.coefficients)

    def _partials(
        self,
        distance: FloatArray,  # noqa: ARG002  the base class's
        current: FloatArray,  # noqa: ARG002
        orders: tuple[tuple[int, int], ...],  # noqa: ARG002
    ) -> list[FloatArray]:
        raise of_one_circuit(f"its sensor's field is of {len(self.current_knots_A)}")

    def _values(self, distance: FloatArray, current: FloatArray, *, slopes: bool) -> list[FloatArray]:
        """The value and, where asked for, its slopes along the distance and each current."""
        n, current = len(self.current_knots_A), np.asarray(current, dtype=np.float64)
        if n > 1 and current.shape[-1:] != (n,):
            raise DomainError(
                f"Currents at a sensor's field must have the shape (..., {n}), one for each circuit in the model's "
                f"order; instead received the shape {current.shape}."
            )
        shape = np.broadcast_shapes(np.shape(distance), current.shape if n < 2 else current.shape[:-1])
        along = [current] if n == 1 else [current[..., k] for k in range(n)]
        flat = [np.broadcast_to(one, shape).ravel() for one in (np.asarray(distance, dtype=np.float64), *along)]
        u, rate, _ = self.coordinate.with_slopes(flat[0])
        axes = list(zip(flat[1:], self.current_knots_A, self.current_degrees, strict=True))
        places = [basis_matrix(*axis) for axis in axes]
        at = np.tensordot(basis_matrix(u, self.u_knots, self.u_degree), self.coefficients, axes=1)
        found = [_contracted(at, places)]
        if slopes:
            risen = np.tensordot(basis_matrix(u, self.u_knots, self.u_degree, 1), self.coefficients, axes=1)
            found.append(rate * _contracted(risen, places))
            for k, axis in enumerate(axes):
                rising = [*places[:k], basis_matrix(*axis, 1), *places[k + 1 :]]
                found.append(_contracted(at, rising))
        return [value.reshape(shape) for value in found]


def _contracted(values: FloatArray, bases: list[FloatArray]) -> FloatArray:
    """Sum over the axes after the first, one circuit's functions after the other."""
    for basis in bases:
        values = np.einsum("pi,pi...->p...", basis, values)
    return values
