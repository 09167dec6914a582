"""Co-energies beside one circuit's spline: of several circuits, and of a plunger's network of gap, iron and leakage.

Distances have the shape (...), currents (..., n) in the circuits' order. Force and all flux linkages are derivatives of
one function, so that dF/di_k = -d(flux linkage_k)/dd and d(flux linkage_j)/di_k = d(flux linkage_k)/di_j hold to
rounding.

References
----------
H. C. Roters, Electromagnetic Devices (Wiley, 1941), chapters IV to VII (permeances, fringing, leakage of plungers).
O. Froelich, Elektrotechnische Zeitschrift 2 (1881) 134 (the curve).
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1 (several terminal pairs).
C. de Boor, A Practical Guide to Splines (Springer, 2001), chapter XVII: tensor products.
"""

from dataclasses import dataclass, field
from functools import cached_property
from math import comb
from typing import Literal

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.numerics import FloatArray
from femfit.model.bspline import FLAT, PARABOLA, DistanceCoordinate, DistanceSplines, functions, nested_shape, spline_at
from femfit.model.magnetics import Magnetics, current_of


@dataclass(frozen=True, eq=False)
class CoenergyMatrix(Magnetics):
    """Several circuits whose iron does not saturate: a quadratic form in their currents.

    W'(d, i_1..i_n) = v^T M(d) v / 2 with v = (1, i_1, .., i_n). M_00 / 2 is what magnets do alone, M_0k the flux
    linkage of circuit k without current, M_jk = M_kj the inductances. The entries are splines in one coordinate of the
    distance.
    """

    kind: Literal["coenergy_matrix"] = field(default="coenergy_matrix", kw_only=True)
    names: tuple[str, ...] = field(metadata={"key": "circuits", "least": 2})  # In the order of their currents
    coordinate: DistanceCoordinate = field(metadata=FLAT)
    u_knots: FloatArray = field(metadata={"degree": "u_degree"})
    u_degree: int = field(metadata={"within": (2, 9)})
    # Of the entries M_ab, a <= b, row by row; shape (functions, (n + 1) (n + 2) / 2)
    coefficients: FloatArray = field(
        metadata={"shape": lambda m: (functions(m.u_knots, m.u_degree), comb(len(m.names) + 2, 2))}
    )

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and currents."""
        v, entries = ca.vertcat(1.0, currents), iter(self._splines.expression(distance))
        value = SX(0.0)
        for j in range(v.numel()):
            for k in range(j, v.numel()):
                value += (0.5 if j == k else 1.0) * next(entries) * v[j] * v[k]
        return value

    @cached_property
    def _splines(self) -> DistanceSplines:
        return DistanceSplines(self.coordinate, self.u_knots, self.u_degree, self.coefficients)


@dataclass(frozen=True, eq=False)
class CircuitAxis:
    """The splines of a circuit's current."""

    name: str
    knots_A: FloatArray = field(metadata={"degree": "degree"})
    degree: int = field(metadata={"within": (2, 9)})


@dataclass(frozen=True, eq=False)
class CoenergyTensor(Magnetics):
    """Several circuits whose iron saturates: a tensor B-spline in the distance and all currents.

    W'(d, i_1..i_n) = sum of c_(a b1..bn) N_a(u(d)) N_b1(i_1) .. N_bn(i_n). Beyond its knots the spline goes on as a
    parabola in each current. A circuit beyond them keeps its own inductance; those of the others still change with its
    current, and far out they are not positive definite together.
    """

    kind: Literal["coenergy_tensor"] = field(default="coenergy_tensor", kw_only=True)
    coordinate: DistanceCoordinate = field(metadata=FLAT)
    u_knots: FloatArray = field(metadata={"degree": "u_degree"})
    u_degree: int = field(metadata={"within": (2, 9)})
    circuits: tuple[CircuitAxis, ...] = field(metadata={"least": 2})  # In the order of their currents
    # In J, shape (functions of u, functions of i_1, ..)
    coefficients: FloatArray = field(metadata={"shape": lambda t: nested_shape(t, t.circuits)})

    @property
    def names(self) -> tuple[str, ...]:
        """Of the circuits."""
        return tuple(circuit.name for circuit in self.circuits)

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and currents."""
        axes = [(self.u_knots, self.u_degree), *((axis.knots_A, axis.degree, PARABOLA) for axis in self.circuits)]
        coordinates = self.coordinate.of(distance), *ca.vertsplit(currents)
        return spline_at(self, axes, self.coefficients[..., None], *coordinates)[0]


NETWORK = "reluctance-network"
"""Name of the law."""

FORMULA = "i = r(d) psi + c psi / (s(d) - psi), F = -dW'/dd"

OPERATIONS = 100
"""Floating-point operations of one force, counted as a law's: logarithms and exponentials twenty each."""


@dataclass(frozen=True, eq=False)
class NetworkMagnetics(Magnetics):
    """A plunger that saturates: a gap and an iron path in series, leakage beside them, in closed form.

    The main flux linkage psi obeys i = r(d) psi + c psi / (s(d) - psi): the gap's part r, and iron that saturates at s
    as Froelich's curve does. That is a quadratic equation for psi. The co-energy is

        W'(d, i) = psi i - r psi^2 / 2 + c (psi + s ln(1 - psi / s)) + L(d) i^2 / 2,

    stationary in psi, so that F = psi^2 r' / 2 - c (ln(1 - y) + y / (1 - y)) s' - L' i^2 / 2 with y = psi / s. With
    x = ln((d + a) / d_0), ln r is a cubic in x, because flux fringes in a power of the gap, and s and L are straight
    lines: what leaks past the gap saturates the iron as well. A current of either sign pulls alike.
    """

    kind: Literal["reluctance_network"] = field(default="reluctance_network", kw_only=True)
    reference_distance_m: float = field(metadata={"positive": True})  # d_0
    distance_shift_m: float  # a
    log_reluctance: tuple[float, float, float, float]  # Of ln r in powers of x, the lowest first; r in A/Wb
    saturation_Wb: tuple[float, float]  # s in powers of x
    knee_A: float = field(metadata={"positive": True})  # c
    leakage_H: tuple[float, float]  # L in powers of x

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and current."""
        x = np.log((distance + self.distance_shift_m) / self.reference_distance_m)
        current, c = current_of(currents), self.knee_A
        size = np.where(current < 0.0, -current, current)  # whose slope is 1 at no current, unlike a magnitude's
        r0, r1, r2, r3 = self.log_reluctance
        r = np.exp(((r3 * x + r2) * x + r1) * x + r0)
        s = self.saturation_Wb[0] + self.saturation_Wb[1] * x
        gap = r * s
        b = gap + size + c
        y = 2.0 * size / (b + np.sqrt(b * b - 4.0 * gap * size))
        psi = y * s
        leakage = self.leakage_H[0] + self.leakage_H[1] * x
        return psi * size - 0.5 * r * psi**2 + c * (psi + s * np.log(1.0 - y)) + 0.5 * leakage * size**2
