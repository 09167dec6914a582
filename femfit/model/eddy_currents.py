"""Eddy currents as windings that are short-circuited: patterns of current, fixed to the conducting parts.

Pattern k carries the current e_k and obeys 0 = R_k e_k + d(its flux linkage)/dt. With the circuits' currents i and
u = i + C(d) e the co-energy is

    W'(d, i, e) = W_s(d, u) + lambda(d) . e + e^T Q(d) e / 2,

W_s the static one, and the field at the Hall element is B_s(d, u) + h(d) . e. A column of C holds the circuits'
currents that act like a pattern, Q is what is left of the patterns' inductances beside these, and lambda of what
magnets link with them. For linear materials this is exact; for others W' is convex in (i, e), and the model passive,
where W_s is convex and Q positive definite.

Distances have the shape (...), n circuits' currents (..., n), r patterns' (..., r).

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1 (several terminal pairs).
A. Odabasioglu, M. Celik and L. T. Pileggi, IEEE Trans. CAD 17 (1998) 645: projection of symmetric, definite systems
keeps them passive.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as limited
from functools import cached_property, partial
from itertools import combinations_with_replacement
from math import comb
from typing import Any

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import Expression
from femfit.core.numerics import FloatArray, IntArray
from femfit.model.bspline import FLAT, DistanceCoordinate, DistanceSplines, functions
from femfit.model.decay import complex_array
from femfit.model.magnetics import Magnetics


@dataclass(frozen=True)
class EddyError:
    """How far the patterns are off the field that they were taken from, relative, at the worst place and frequency.

    They stand beside the static model, whose own error at the same currents is told apart from theirs.
    """

    frequency_min_Hz: float = limited(metadata={"lower": 0.0})
    frequency_max_Hz: float
    impedance: float | None = limited(default=None, metadata={"lower": 0.0})  # None where there is no circuit
    force: float | None = limited(default=None, metadata={"lower": 0.0})  # Of the force for each ampere
    # Of the Hall element's field for each ampere; None where there is none
    hall: float | None = limited(default=None, metadata={"lower": 0.0})
    # Where iron saturates: largest error of the static inductance and of dF/di at the currents about which the patterns
    # were solved, most of which are between the sweep's, over the largest of these
    static_inductance: float | None = limited(default=None, metadata={"lower": 0.0})
    static_force: float | None = limited(default=None, metadata={"lower": 0.0})

    @property
    def largest(self) -> float:
        """The worst of the patterns' three."""
        return max((error for error in (self.impedance, self.force, self.hall) if error is not None), default=0.0)


@dataclass(frozen=True, eq=False)
class EddyBias:
    """The currents about which the patterns beside iron that saturates were solved: elsewhere they are guesses."""

    distances_m: FloatArray = limited(metadata={"dimensions": (1,)})  # Ascending, shape (D,)
    current_A: FloatArray = limited(metadata={"dimensions": (2,)})  # Shape (D, n)
    materials: tuple[str, ...] = ()  # Those that saturate and conduct

    def faults(self) -> Iterator[tuple[str, str]]:
        """Distances that do not grow, and currents of others."""
        if not len(self.distances_m) or not (np.diff(self.distances_m) > 0.0).all():
            yield "distances_m", "numbers that grow"
        if len(self.current_A) != len(self.distances_m):
            yield "current_A", f"{len(self.distances_m)} lists of numbers, as the knots and names beside it ask for"

    def at(self, distance: FloatArray) -> FloatArray:
        """The currents in A at distances (...), between the sweep's by straight lines; shape (..., n)."""
        return np.stack([np.interp(distance, self.distances_m, course) for course in self.current_A.T], axis=-1)


@dataclass(frozen=True, eq=False)
class EddyForms:
    """C, lambda, Q and h at distances, or a derivative of theirs in d; at one as arrays of complex expressions."""

    coupling: Any  # C, shape (..., n, r)
    flux_linkage: Any  # lambda in Wb, shape (..., r)
    inductance: Any  # Q in H, shape (..., r, r)
    hall: Any  # h in T/A, shape (..., r); zeros without a Hall element
    resistances_ohm: Any  # Shape (r,)


def _functions(eddy: Any) -> tuple[int]:
    """N."""
    return (functions(eddy.u_knots, eddy.u_degree),)


@dataclass(frozen=True, eq=False)
class EddyCurrents:
    """The patterns of a model; what depends on the distance are splines with N functions of u(d).

    Examples
    --------
    >>> import numpy as np
    >>> from femfit.model.bspline import DistanceCoordinate
    >>> ring = EddyCurrents(
    ...     names=("eddy_1",), resistances_ohm=np.array([1.0]), circuits=("coil",),
    ...     coordinate=DistanceCoordinate(1e-3, kind="distance"), u_knots=np.array([0.0, 0.0, 0.0, 5.0, 5.0, 5.0]),
    ...     u_degree=2, couplings=np.full((3, 1, 1), 0.02), flux_linkages_Wb=np.zeros((3, 1)),
    ...     inductances_H=np.full((3, 1), 1e-3),
    ... )
    >>> ring.forms(np.array(2e-3))[0].inductance
    array([[0.001]])
    """

    names: tuple[str, ...]
    circuits: tuple[str, ...]  # In the order of C's rows
    coordinate: DistanceCoordinate = limited(metadata=FLAT)
    u_degree: int = limited(metadata={"within": (2, 9)})
    resistances_ohm: FloatArray = limited(metadata={"dimensions": (1,)})  # Shape (r,)
    u_knots: FloatArray = limited(metadata={"degree": "u_degree"})
    couplings: FloatArray = limited(metadata={"shape": lambda e: (*_functions(e), len(e.circuits), len(e.names))})  # C
    flux_linkages_Wb: FloatArray = limited(metadata={"shape": lambda e: (*_functions(e), len(e.names))})  # lambda
    # Q_jk, j <= k, row by row
    inductances_H: FloatArray = limited(metadata={"shape": lambda e: (*_functions(e), comb(len(e.names) + 1, 2))})
    # h, of lambda's shape; None where the drawing has no Hall element
    hall_T_per_A: FloatArray | None = limited(
        default=None, metadata={"omit": True, "shape": lambda e: (*_functions(e), len(e.names))}
    )
    error: EddyError | None = None
    # None where nothing saturates: the patterns hold for all currents
    bias: EddyBias | None = limited(default=None, metadata={"omit": True})

    def faults(self) -> Iterator[tuple[str, str]]:
        """What no patterns can have."""
        if len({*self.names, *self.circuits, ""}) <= len(self.names) + len(self.circuits):
            yield "names", "names that differ from each other and from the circuits'"
        if not self.names or len(self.resistances_ohm) != len(self.names) or not np.all(self.resistances_ohm > 0.0):
            yield "resistances_ohm", "as many numbers > 0 as there are names, and one at least"
        if self.bias is not None and self.bias.current_A.shape[1:] != (len(self.circuits),):
            yield "bias.current_A", f"lists of {len(self.circuits)} numbers, as the names ask for"
        (nodes,) = self.forms(self.coordinate.distance(np.unique(self.u_knots)))
        if not np.linalg.eigvalsh(nodes.inductance).min() > 0.0:
            yield "inductances_H", "those of a positive definite matrix at every distance"

    @property
    def count(self) -> int:
        """Number of patterns r."""
        return len(self.names)

    def forms(self, distance: FloatArray, *orders: int) -> list[EddyForms]:
        """C, lambda, Q and h at distances, or their derivatives in d of the orders that are given, up to the second."""
        slopes, n, r = [], len(self.circuits), self.count
        for entries in self._splines.derivatives(distance, *(orders or (0,))):
            coupling, linkage, hall, inductance = np.split(entries, [n * r, (n + 1) * r, (n + 2) * r], axis=-1)
            coupling = coupling.reshape(*coupling.shape[:-1], n, r)
            inductance = inductance[..., self._places]
            slopes.append(EddyForms(coupling, linkage, inductance, hall, self.resistances_ohm))
        return slopes

    def patterns(self, distance: SX, currents: Sequence[Expression], factor: Expression) -> EddyForms:
        """What an impedance takes at an expression's distance, beside scaled numbers of turns and resistances."""
        coupling, linkage, hall, inductance = map(complex_array, self._entries(distance))
        resistances = complex_array(factor * SX(self.resistances_ohm))[:, 0]
        coupling = coupling / complex_array(SX(ca.vertcat(*currents)))
        return EddyForms(coupling, linkage, inductance[:, 0][self._places], hall, resistances)

    def scaled(self, magnets: float, currents: FloatArray) -> "EddyCurrents":
        """The patterns beside magnets and numbers of turns that are scaled: W_s(d, s u) has u = i + C e / s."""
        bias = self.bias and replace(self.bias, current_A=self.bias.current_A / np.asarray(currents))
        return replace(
            self,
            bias=bias,
            couplings=self.couplings / np.asarray(currents)[:, None],
            flux_linkages_Wb=magnets * self.flux_linkages_Wb,
        )

    def expression(self, inner: Callable[[SX, SX], SX], distance: SX, currents: SX) -> SX:
        """W'(d, i, e) of all currents, from the static W_s(d, u)."""
        u, e, (_, linkage, _, inductance) = self.acting(distance, currents)
        energy = SX(0.0)
        for place, (j, k) in enumerate(combinations_with_replacement(range(self.count), 2)):
            energy += (0.5 if j == k else 1.0) * inductance[place] * e[j] * e[k]
        return inner(distance, u) + ca.dot(linkage, e) + energy

    def field(self, inner: Callable[[SX, SX], SX], distance: SX, currents: SX) -> SX:
        """B(d, i, e) at the Hall element, from the static B_s(d, u)."""
        u, e, (_, _, hall, _) = self.acting(distance, currents)
        return inner(distance, u) + ca.dot(hall, e)

    def acting(self, distance: SX, currents: SX) -> tuple[SX, SX, tuple[SX, SX, SX, SX]]:
        """The currents u = i + C e that act, those of the patterns, and what depends on the distance."""
        entries, (i, e) = self._entries(distance), ca.vertsplit(currents, [0, len(self.circuits), currents.numel()])
        return i + entries[0] @ e, e, entries

    def _entries(self, distance: SX) -> tuple[SX, SX, SX, SX]:
        """C, lambda, h, and the entries of Q above the diagonal, row by row."""
        n, r = len(self.circuits), self.count
        entries = ca.vertcat(*self._splines.expression(distance))
        coupling, linkage, hall, inductance = ca.vertsplit(
            entries, [0, n * r, (n + 1) * r, (n + 2) * r, entries.numel()]
        )
        return ca.reshape(coupling, r, n).T, linkage, hall, inductance

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
class EddyMagnetics(Magnetics):
    """The co-energy W'(d, i, e) beside eddy currents; its currents are (i_1..i_n, e_1..e_r)."""

    static: Magnetics
    eddy: EddyCurrents

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and currents."""
        return self.with_memory({})(distance, currents)

    def with_memory(self, memory: Mapping[str, SX]) -> Callable[[SX, SX], SX]:
        """The same where the states of effects are these."""
        return partial(self.eddy.expression, self.static.with_memory(memory))
