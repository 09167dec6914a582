"""Eddy currents as windings that are short-circuited: patterns of current, fixed to the conducting parts.

Pattern k carries the current e_k and obeys 0 = R_k e_k + d(its flux linkage)/dt. With the circuits' currents i and
u = i + C(d) e the co-energy is

    W'(d, i, e) = W_s(d, u) + lambda(d) . e + e^T Q(d) e / 2,

W_s the static one, and the field at the Hall element is B_s(d, u) + h(d) . e. A column of C holds the circuits'
currents that act like a pattern, Q is what is left of the patterns' inductances beside these, and lambda of what
magnets link with them. For linear materials this is exact; for others W' is convex in (i, e), and the model passive,
where W_s is convex and Q positive definite.

Distances have the shape (...), n circuits' currents (..., n), r patterns' (..., r).

The field at a Hall element beside eddy currents, B_s(d, u) + h(d) . e with u = i + C e.

Where B_s is linear in the currents, the whole is B_0(d) + b(d) . (i, e), which a table holds.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1 (several terminal pairs).
A. Odabasioglu, M. Celik and L. T. Pileggi, IEEE Trans. CAD 17 (1998) 645: projection of symmetric, definite systems
keeps them passive.
"""

from dataclasses import dataclass, replace
from dataclasses import field as limited
from functools import cached_property

import numpy as np

from femfit.core.numerics import FloatArray, IntArray
from femfit.model.coordinate import DistanceCoordinate, DistanceSplines
from femfit.model.distance_table import DistanceTable, distance_table
from femfit.model.hall import HallField, HallSpline, SensedField


@dataclass(frozen=True)
class EddyError:
    """How far the patterns are off the field that they were taken from, relative, at the worst place and frequency.

    They stand beside the static model, whose own error at the same currents is told apart from theirs.
    """

    frequency_min_Hz: float = limited(metadata={"lower": 0.0})
    frequency_max_Hz: float = limited(metadata={"not_below": "frequency_min_Hz"})
    impedance: float | None = limited(default=None, metadata={"lower": 0.0})  # None where there is no circuit
    force: float | None = limited(default=None, metadata={"lower": 0.0})  # Of the force for each ampere
    hall: float | None = limited(
        default=None, metadata={"lower": 0.0}
    )  # Of the Hall element's field for each ampere; None where there is none
    # Where iron saturates: largest error of the static inductance and of dF/di at the currents about which the patterns
    # were solved, most of which are between the sweep's, over the largest of these
    static_inductance: float | None = limited(default=None, metadata={"lower": 0.0})
    static_force: float | None = limited(default=None, metadata={"lower": 0.0})

    @property
    def largest(self) -> float:
        """The worst of the patterns' three."""
        return max((one for one in (self.impedance, self.force, self.hall) if one is not None), default=0.0)


@dataclass(frozen=True, eq=False)
class EddyBias:
    """The currents about which the patterns beside iron that saturates were solved: elsewhere they are guesses."""

    distances_m: FloatArray  # Ascending, shape (D,)
    current_A: FloatArray  # Shape (D, n)
    materials: tuple[str, ...] = ()  # Those that saturate and conduct

    def at(self, distance: FloatArray) -> FloatArray:
        """The currents in A at distances (...), between the sweep's by straight lines; shape (..., n)."""
        return np.stack([np.interp(distance, self.distances_m, one) for one in self.current_A.T], axis=-1)


@dataclass(frozen=True, eq=False)
class EddyForms:
    """C, lambda, Q and h at distances, or a derivative of theirs in d.

    For all n + r currents w = (i, e) together G = (1, C) stands in place of C, u = G w, and the others are zero for the
    circuits.
    """

    coupling: FloatArray  # C, shape (..., n, r)
    flux_linkage: FloatArray  # lambda in Wb, shape (..., r)
    inductance: FloatArray  # Q in H, shape (..., r, r)
    hall: FloatArray  # h in T/A, shape (..., r); zeros without a Hall element


@dataclass(frozen=True, eq=False)
class EddyCurrents:
    """The patterns of a model; what depends on the distance are splines with N functions of u(d).

    Examples
    --------
    >>> import numpy as np
    >>> from femfit.model.coordinate import DistanceCoordinate
    >>> ring = EddyCurrents(
    ...     names=("eddy_1",), resistances_ohm=np.array([1.0]), circuits=("coil",),
    ...     coordinate=DistanceCoordinate(1e-3, inverse=False), u_knots=np.array([0.0, 0.0, 0.0, 5.0, 5.0, 5.0]),
    ...     u_degree=2, couplings=np.full((3, 1, 1), 0.02), flux_linkages_Wb=np.zeros((3, 1)),
    ...     inductances_H=np.full((3, 1), 1e-3),
    ... )
    >>> ring.forms(np.array(2e-3))[0].inductance
    array([[0.001]])
    """

    names: tuple[str, ...]
    resistances_ohm: FloatArray  # Shape (r,)
    circuits: tuple[str, ...]  # In the order of C's rows
    coordinate: DistanceCoordinate
    u_knots: FloatArray
    u_degree: int
    couplings: FloatArray  # C, shape (N, n, r)
    flux_linkages_Wb: FloatArray  # lambda, shape (N, r)
    inductances_H: FloatArray  # Q_jk, j <= k, row by row; shape (N, r (r + 1) / 2)
    hall_T_per_A: FloatArray | None = None  # h, shape (N, r); None where the drawing has no Hall element
    error: EddyError | None = None
    bias: EddyBias | None = None  # None where nothing saturates: the patterns hold for all currents

    @property
    def count(self) -> int:
        """Number of patterns r."""
        return len(self.names)

    def forms(self, distance: FloatArray, *orders: int) -> list[EddyForms]:
        """C, lambda, Q and h at distances, or their derivatives in d of the orders that are given, up to the second."""
        found, n, r = [], len(self.circuits), self.count
        for entries in self._splines.derivatives(distance, *(orders or (0,))):
            coupling, linkage, hall, inductance = np.split(entries, [n * r, (n + 1) * r, (n + 2) * r], axis=-1)
            coupling = coupling.reshape(*coupling.shape[:-1], n, r)
            found.append(EddyForms(coupling, linkage, inductance[..., self._places], hall))
        return found

    def whole_forms(self, distance: FloatArray, *orders: int) -> list[EddyForms]:
        """As :meth:`forms`, for all currents."""
        found, orders, n, m = [], orders or (0,), len(self.circuits), len(self.circuits) + self.count
        for order, one in zip(orders, self.forms(distance, *orders), strict=True):
            points = one.flux_linkage.shape[:-1]
            coupling, linkage, inductance, hall = (np.zeros((*points, *size)) for size in ((n, m), (m,), (m, m), (m,)))
            coupling[..., :n], coupling[..., n:] = np.eye(n) * (order == 0), one.coupling
            linkage[..., n:], inductance[..., n:, n:], hall[..., n:] = one.flux_linkage, one.inductance, one.hall
            found.append(EddyForms(coupling, linkage, inductance, hall))
        return found

    def scaled(self, magnets: float, currents: FloatArray) -> "EddyCurrents":
        """The patterns beside magnets and numbers of turns that are scaled: W_s(d, s u) has u = i + C e / s."""
        bias = self.bias and replace(self.bias, current_A=self.bias.current_A / np.asarray(currents))
        return replace(
            self,
            bias=bias,
            couplings=self.couplings / np.asarray(currents)[:, None],
            flux_linkages_Wb=magnets * self.flux_linkages_Wb,
        )

    @cached_property
    def _places(self) -> IntArray:
        """Which entry of Q stands at (j, k), shape (r, r)."""
        places = np.zeros((self.count, self.count), dtype=np.int64)
        rows, columns = np.triu_indices(self.count)
        places[rows, columns] = places[columns, rows] = np.arange(len(rows))
        return places

    @cached_property
    def _splines(self) -> DistanceSplines:
        hall = np.zeros_like(self.flux_linkages_Wb) if self.hall_T_per_A is None else self.hall_T_per_A
        couplings = self.couplings.reshape(len(hall), len(self.circuits) * self.count)
        entries = np.concatenate([couplings, self.flux_linkages_Wb, hall, self.inductances_H], axis=1)
        return DistanceSplines(self.coordinate, self.u_knots, self.u_degree, entries)


@dataclass(frozen=True, eq=False)
class EddyHall:
    """The field of the module's head; currents are (i, e) of shape (N, n + r), distances (N,)."""

    eddy: EddyCurrents
    static: HallField

    def field(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """B in T, of shape (N,)."""
        table = self._table
        if table is None:
            return self._exact(distance, currents)
        beyond, inside, cell = table.in_order(distance)
        at = table.values(distance[inside], cell)
        found = np.asarray(at[0] + np.einsum("jn,jn->n", at[1:], currents.T[:, inside]))
        if isinstance(inside, slice):
            return found
        result = np.empty(len(distance))
        result[inside] = found
        if len(beyond):
            result[beyond] = self._exact(distance[beyond], currents[beyond])
        return result

    def acting(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """The circuits' currents u (N, n) whose static field is there."""
        return np.asarray((self.eddy.whole_forms(distance)[0].coupling @ currents[..., None])[..., 0])

    def _exact(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        (at,) = self.eddy.whole_forms(distance)
        u = (at.coupling @ currents[..., None])[..., 0]
        return np.asarray(self.static.field(distance, u) + (at.hall * currents).sum(axis=1))

    @cached_property
    def _table(self) -> DistanceTable | None:
        """B_0 in T, and b in T/A."""
        spline = _spline(self.static)
        if spline is None:
            return None
        kinds = [np.ones(count) for count in (1, len(self.eddy.circuits), self.eddy.count) if count]
        return distance_table(self._entries, ((self.eddy.coordinate, self.eddy.u_knots), spline), kinds)

    def _entries(self, distance: FloatArray) -> FloatArray:
        (at,), n = self.eddy.whole_forms(distance), len(self.eddy.circuits)
        value, _, by_circuit = self.static.derivatives(distance, np.zeros((len(distance), n)))
        by_winding = (by_circuit[:, None] @ at.coupling)[:, 0] + at.hall
        return np.concatenate([value[:, None], by_winding], axis=1)


def _spline(field: HallField) -> tuple[DistanceCoordinate, FloatArray] | None:
    """Coordinate and knots of a field that is linear in the currents; None of others."""
    if isinstance(field, HallSpline):
        axes, knots = [(field.spline.y_degree, field.spline.y_knots)], field.spline.x_knots
    elif isinstance(field, SensedField):
        axes, knots = list(zip(field.current_degrees, field.current_knots_A, strict=True)), field.u_knots
    else:
        return None
    linear = all(degree <= 1 and len(np.unique(own)) == 2 for degree, own in axes)
    return (field.coordinate, knots) if linear else None
