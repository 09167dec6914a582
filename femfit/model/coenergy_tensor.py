"""The co-energy of several circuits whose iron saturates: a tensor B-spline in the distance and all currents.

W'(d, i_1..i_n) = sum of c_(a b1..bn) N_a(u(d)) N_b1(i_1) .. N_bn(i_n). Force and all flux linkages are derivatives of
the one function, so that dF/di_k = -d(flux linkage_k)/dd and d(flux linkage_j)/di_k = d(flux linkage_k)/di_j hold to
rounding. Beyond its knots the spline goes on as a parabola in each current. A circuit beyond them keeps its own
inductance; those of the others still change with its current, and far out they are not positive definite together.

Distances have the shape (...), currents (..., n) in the circuits' order.

References
----------
C. de Boor, A Practical Guide to Splines (Springer, 2001), chapter XVII: tensor products.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.basis_polynomials import BasisPolynomials, Places
from femfit.model.bspline import PARABOLA
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.magnetics import MagneticSlopes, MagneticState
from femfit.model.several_magnetics import SeveralMagnetics


@dataclass(frozen=True, eq=False)
class CoenergyTensor(SeveralMagnetics):
    """The spline of the module's head."""

    names: tuple[str, ...]  # Of the circuits, in the order of their currents
    coordinate: DistanceCoordinate
    u_knots: FloatArray
    u_degree: int
    current_knots_A: tuple[FloatArray, ...]  # Of each circuit
    current_degrees: tuple[int, ...]
    coefficients: FloatArray  # In J, shape (functions of u, functions of i_1, ..)

    @cached_property
    def axes(self) -> tuple[BasisPolynomials, ...]:
        """The basis functions of u and of each current."""
        currents = zip(self.current_knots_A, self.current_degrees, strict=True)
        return (
            BasisPolynomials(self.u_knots, self.u_degree),
            *(BasisPolynomials(*axis, PARABOLA) for axis in currents),
        )

    def flux_linkage(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """dW'/di_k in Wb, of shape (..., n)."""
        at = _Point(self, distance, current)
        return np.stack([at.partial(0, k) for k in range(len(self.names))], axis=-1)

    def coenergy(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """W' in J, up to a constant, of shape (...)."""
        return _Point(self, distance, current).partial(0)

    def state(self, distance: FloatArray, current: FloatArray) -> MagneticState:
        """Force (...), motional constants (..., n) and inductances (..., n, n) together."""
        at, n = _Point(self, distance, current), len(self.names)
        motional = -np.stack([at.partial(1, k) for k in range(n)], axis=-1)
        return MagneticState(-at.partial(1), motional, at.inductance(0))

    def slopes_of_circuits(self, distance: FloatArray, currents: FloatArray) -> MagneticSlopes:
        """Slopes along the distance and the currents."""
        at, n = _Point(self, distance, currents), len(self.names)
        third = [[[at.partial(0, j, k, m) for m in range(n)] for k in range(n)] for j in range(n)]
        return MagneticSlopes(
            motional_constant=-np.stack([at.partial(1, k) for k in range(n)], axis=-1),
            inductance=at.inductance(0),
            force=-at.partial(1),
            force_gradient=-at.partial(2),
            motional_gradient=-np.stack([at.partial(2, k) for k in range(n)], axis=-1),
            inductance_gradient=at.inductance(1),
            inductance_slope=np.moveaxis(np.array(third), (0, 1, 2), (-3, -2, -1)),
        )


class _Point:
    """Partial derivatives at points, each part of the products worked out once."""

    def __init__(self, tensor: CoenergyTensor, distance: FloatArray, current: FloatArray) -> None:
        current = np.asarray(current, dtype=np.float64)
        self.shape = np.broadcast_shapes(np.shape(distance), current.shape[:-1])
        self.tensor = tensor
        self.u = [
            np.broadcast_to(part, self.shape).ravel()
            for part in tensor.coordinate.with_slopes(np.asarray(distance, dtype=np.float64))
        ]
        self.currents = [np.broadcast_to(current[..., k], self.shape).ravel() for k in range(len(tensor.names))]
        self._places: dict[int, Places] = {}
        self._along_u: dict[int, FloatArray] = {}
        self._bases: dict[tuple[int, int], FloatArray] = {}
        self._partials: dict[tuple[int, ...], FloatArray] = {}

    def partial(self, order: int, *circuits: int) -> FloatArray:
        """Derivative of this order in d, and once in the current of each circuit that is named, of shape (...)."""
        key = (order, *sorted(circuits))
        if key not in self._partials:
            value = self._at_distance(order)
            for k in range(len(self.currents)):
                # The first of the remaining axes is the next circuit's
                value = np.einsum("pi,pi...->p...", self._basis(k, circuits.count(k)), value)
            self._partials[key] = value.reshape(self.shape)
        return self._partials[key]

    def inductance(self, order: int) -> FloatArray:
        """d^2 W'/di_j di_k, or its derivative in d, of shape (..., n, n)."""
        n = range(len(self.currents))
        return np.stack([np.stack([self.partial(order, j, k) for k in n], axis=-1) for j in n], axis=-2)

    def _at_distance(self, order: int) -> FloatArray:
        """The coefficients of the products in the currents, (points, functions of i_1, ..)."""
        _, first, second = self.u
        if order == 0:
            return self._in_u(0)
        each = (slice(None), *[None] * len(self.currents))
        if order == 1:
            return first[each] * self._in_u(1)
        return first[each] ** 2 * self._in_u(2) + second[each] * self._in_u(1)

    def _in_u(self, order: int) -> FloatArray:
        if order not in self._along_u:
            tensor = self.tensor
            basis = tensor.axes[0].values(self._place(0), order)
            self._along_u[order] = np.tensordot(basis, tensor.coefficients, axes=1)
        return self._along_u[order]

    def _basis(self, circuit: int, order: int) -> FloatArray:
        if (circuit, order) not in self._bases:
            self._bases[circuit, order] = self.tensor.axes[1 + circuit].values(self._place(1 + circuit), order)
        return self._bases[circuit, order]

    def _place(self, axis: int) -> Places:
        if axis not in self._places:
            self._places[axis] = self.tensor.axes[axis].places([self.u[0], *self.currents][axis])
        return self._places[axis]
