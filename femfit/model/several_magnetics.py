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

from dataclasses import dataclass, field
from functools import cached_property
from math import comb
from typing import Literal

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.numerics import FloatArray
from femfit.model.bspline import PARABOLA, CellTable, cell_table, cells_of, functions, nested_shape
from femfit.model.coordinate import FLAT_OF_SEVERAL, DistanceCoordinate, DistanceSplines
from femfit.model.magnetics import Magnetics


@dataclass(frozen=True, eq=False)
class CoenergyMatrix(Magnetics):
    """M(d) of the module's head."""

    kind: Literal["coenergy_matrix"] = field(default="coenergy_matrix", kw_only=True)
    names: tuple[str, ...] = field(metadata={"key": "circuits", "least": 2})  # In the order of their currents
    coordinate: DistanceCoordinate = field(metadata=FLAT_OF_SEVERAL)
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

    def matrix(self, distance: FloatArray, order: int = 0) -> FloatArray:
        """M, or a derivative of it in d, at distances of any shape, (..., n + 1, n + 1)."""
        (entries,) = self._splines.derivatives(distance, order)
        size = len(self.names) + 1
        result = np.empty((*entries.shape[:-1], size, size))
        rows, columns = np.triu_indices(size)
        result[..., rows, columns] = result[..., columns, rows] = entries
        return result

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
    """The spline of the module's head."""

    kind: Literal["coenergy_tensor"] = field(default="coenergy_tensor", kw_only=True)
    coordinate: DistanceCoordinate = field(metadata=FLAT_OF_SEVERAL)
    u_knots: FloatArray = field(metadata={"degree": "u_degree"})
    u_degree: int = field(metadata={"within": (2, 9)})
    circuits: tuple[CircuitAxis, ...] = field(metadata={"least": 2})  # In the order of their currents
    # In J, shape (functions of u, functions of i_1, ..)
    coefficients: FloatArray = field(metadata={"shape": lambda t: nested_shape(t, t.circuits)})

    @property
    def names(self) -> tuple[str, ...]:
        """Of the circuits."""
        return tuple(one.name for one in self.circuits)

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and currents."""
        return cell_table(self, self._cells).at(self.coordinate.of(distance), *ca.vertsplit(currents))[0]

    def _cells(self) -> CellTable:
        along = (cells_of(one.knots_A, one.degree, PARABOLA) for one in self.circuits)
        return CellTable([cells_of(self.u_knots, self.u_degree), *along], self.coefficients[..., None])
