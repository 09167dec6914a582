"""The co-energy of several circuits whose iron does not saturate: a quadratic form in their currents.

W'(d, i_1..i_n) = v^T M(d) v / 2 with v = (1, i_1, .., i_n). M_00 / 2 is what magnets do alone, M_0k the flux linkage of
circuit k without current, M_jk the inductances. The entries are splines in one coordinate of the distance. Force and
all flux linkages are derivatives of the one function, so that dF/di_k = -d(flux linkage_k)/dd and M_jk = M_kj hold to
rounding.

Distances have the shape (...), currents (..., n) in the circuits' order.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1 (several terminal pairs).
"""

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.distance_splines import DistanceSplines
from femfit.model.magnetics import ForceOfCurrents, MagneticSlopes, MagneticState
from femfit.model.several_magnetics import SeveralMagnetics


@dataclass(frozen=True, eq=False)
class CoenergyMatrix(SeveralMagnetics):
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

    def flux_linkage(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """dW'/di_k in Wb, of shape (..., n)."""
        return np.asarray(np.einsum("...ab,...b->...a", self.matrix(distance)[..., 1:, :], _with_one(current)))

    def coenergy(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """W' in J, up to a constant, of shape (...)."""
        v = _with_one(current)
        return np.asarray(0.5 * np.einsum("...a,...ab,...b->...", v, self.matrix(distance), v))

    def state(self, distance: FloatArray, current: FloatArray) -> MagneticState:
        """Force (...), motional constants (..., n) and inductances (..., n, n) together."""
        whole, rising = self._matrices(distance, 0, 1)
        force, motional_constant = _force_and_motional_constant(rising, current)
        shape = (*motional_constant.shape, len(self.names))
        return MagneticState(force, motional_constant, np.broadcast_to(whole[..., 1:, 1:], shape).copy())

    def at_distances(self, distance: FloatArray) -> ForceOfCurrents:
        """As the base class's, with the matrices found once."""
        return partial(_force_and_motional_constant, self.matrix(distance, 1))

    def slopes_of_circuits(self, distance: FloatArray, currents: FloatArray) -> MagneticSlopes:
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
