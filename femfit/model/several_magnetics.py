"""The co-energy of several circuits whose iron does not saturate: a quadratic form in their currents.

W'(d, i_1..i_n) = v^T M(d) v / 2 with v = (1, i_1, .., i_n). M_00 / 2 is what magnets do alone, M_0k the flux linkage of
circuit k without current, M_jk the inductances. The entries are splines in one coordinate of the distance. Force and
all flux linkages are derivatives of the one function, so that dF/di_k = -d(flux linkage_k)/dd and M_jk = M_kj hold to
rounding.

Distances have the shape (...), currents (..., n) in the circuits' order.

The co-energy of several circuits whose iron saturates: a tensor B-spline in the distance and all currents.

W'(d, i_1..i_n) = sum of c_(a b1..bn) N_a(u(d)) N_b1(i_1) .. N_bn(i_n). Force and all flux linkages are derivatives of
the one function, so that dF/di_k = -d(flux linkage_k)/dd and d(flux linkage_j)/di_k = d(flux linkage_k)/di_j hold to
rounding. Beyond its knots the spline goes on as a parabola in each current. A circuit beyond them keeps its own
inductance; those of the others still change with its current, and far out they are not positive definite together.

Distances have the shape (...), currents (..., n) in the circuits' order.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1 (several terminal pairs).
C. de Boor, A Practical Guide to Splines (Springer, 2001), chapter XVII: tensor products.
"""

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from femfit.core.numerics import FloatArray, IntArray
from femfit.model.bspline import PARABOLA, BasisPolynomials, Places
from femfit.model.coordinate import DistanceCoordinate, DistanceSplines
from femfit.model.magnetics import ForceOfCurrents, Magnetics, MagneticSlopes, MagneticState


@dataclass(frozen=True, eq=False)
class CoenergyMatrix(Magnetics):
    """M(d) of the module's head."""

    names: tuple[str, ...]  # Of the circuits, in the order of their currents
    coordinate: DistanceCoordinate
    u_knots: FloatArray
    u_degree: int
    # Of the entries M_ab, a <= b, row by row; shape (functions, (n + 1) (n + 2) / 2)
    coefficients: FloatArray

    def matrix(self, distance: FloatArray, order: int = 0) -> FloatArray:
        """M, or its derivative in d of first or second order, at distances of any shape, (..., n + 1, n + 1)."""
        return self._matrices(distance, order)[0]

    def _matrices(self, distance: FloatArray, *orders: int) -> list[FloatArray]:
        return [entries[..., self._places] for entries in self._splines.derivatives(distance, *orders)]

    def flux_linkage(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """dW'/di_k in Wb, of shape (..., n)."""
        return np.asarray(np.einsum("...ab,...b->...a", self.matrix(distance)[..., 1:, :], _with_one(currents)))

    def coenergy(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """W' in J, up to a constant, of shape (...)."""
        v = _with_one(currents)
        return np.asarray(0.5 * np.einsum("...a,...ab,...b->...", v, self.matrix(distance), v))

    def state(self, distance: FloatArray, currents: FloatArray) -> MagneticState:
        """Force (...), motional constants (..., n) and inductances (..., n, n) together."""
        whole, rising = self._matrices(distance, 0, 1)
        force, motional_constant = _force_and_motional_constant(rising, currents)
        shape = (*motional_constant.shape, len(self.names))
        return MagneticState(force, motional_constant, np.broadcast_to(whole[..., 1:, 1:], shape).copy())

    def at_distances(self, distance: FloatArray) -> ForceOfCurrents:
        """As the base class's, with the matrices found once."""
        return partial(_force_and_motional_constant, self.matrix(distance, 1))

    def slopes(self, distance: FloatArray, currents: FloatArray) -> MagneticSlopes:
        """Slopes along the distance; nothing saturates, so that those of the inductances along the currents are 0."""
        v = _with_one(currents)
        whole, rising, bent = self._matrices(distance, 0, 1, 2)
        curved = np.einsum("...ab,...b->...a", bent, v)
        force, motional_constant = _force_and_motional_constant(rising, currents)
        shape = (*motional_constant.shape, len(self.names))
        inductance = np.broadcast_to(whole[..., 1:, 1:], shape).copy()
        return MagneticSlopes(
            motional_constant=motional_constant,
            inductance=inductance,
            force=force,
            force_gradient=-0.5 * np.einsum("...a,...a->...", v, curved),
            motional_gradient=-curved[..., 1:],
            inductance_gradient=np.broadcast_to(rising[..., 1:, 1:], inductance.shape),
            inductance_slope=np.zeros((*inductance.shape, len(self.names))),
        )

    @cached_property
    def _places(self) -> IntArray:
        """Which entry stands at (a, b), shape (n + 1, n + 1)."""
        places = np.zeros((len(self.names) + 1,) * 2, dtype=np.int64)
        rows, columns = np.triu_indices(len(places))
        places[rows, columns] = places[columns, rows] = np.arange(len(rows))
        return places

    @cached_property
    def _splines(self) -> DistanceSplines:
        return DistanceSplines(self.coordinate, self.u_knots, self.u_degree, self.coefficients)


def _with_one(current: FloatArray) -> FloatArray:
    current = np.asarray(current, dtype=np.float64)
    return np.concatenate([np.ones((*current.shape[:-1], 1)), current], axis=-1)


def _force_and_motional_constant(rising: FloatArray, current: FloatArray) -> tuple[FloatArray, FloatArray]:
    """From dM/dd."""
    v = _with_one(current)
    pull = np.einsum("...ab,...b->...a", rising, v)
    return np.asarray(-0.5 * np.einsum("...a,...a->...", v, pull)), -pull[..., 1:]


@dataclass(frozen=True, eq=False)
class CoenergyTensor(Magnetics):
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

    def flux_linkage(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """dW'/di_k in Wb, of shape (..., n)."""
        at = _Point(self, distance, currents)
        return np.stack([at.partial(0, k) for k in range(len(self.names))], axis=-1)

    def coenergy(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """W' in J, up to a constant, of shape (...)."""
        return _Point(self, distance, currents).partial(0)

    def state(self, distance: FloatArray, currents: FloatArray) -> MagneticState:
        """Force (...), motional constants (..., n) and inductances (..., n, n) together."""
        at, n = _Point(self, distance, currents), len(self.names)
        motional = -np.stack([at.partial(1, k) for k in range(n)], axis=-1)
        return MagneticState(-at.partial(1), motional, at.inductance(0))

    def slopes(self, distance: FloatArray, currents: FloatArray) -> MagneticSlopes:
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

    def __init__(self, tensor: CoenergyTensor, distance: FloatArray, currents: FloatArray) -> None:
        currents = np.asarray(currents, dtype=np.float64)
        self.shape = np.broadcast_shapes(np.shape(distance), currents.shape[:-1])
        self.tensor = tensor
        self.u = [
            np.broadcast_to(part, self.shape).ravel()
            for part in tensor.coordinate.with_slopes(np.asarray(distance, dtype=np.float64))
        ]
        self.currents = [np.broadcast_to(currents[..., k], self.shape).ravel() for k in range(len(tensor.names))]
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
