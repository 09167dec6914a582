"""The field at a Hall element beside eddy currents, B_s(d, u) + h(d) . e with u = i + C e.

Where B_s is linear in the currents, the whole is B_0(d) + b(d) . (i, e), which a table holds.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.distance_table import DistanceTable, distance_table
from femfit.model.eddy_currents import EddyCurrents
from femfit.model.hall import HallField, HallSpline
from femfit.model.sensed_field import SensedField


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
        """The circuits' currents u whose static field is there, in the shape that it takes."""
        return self._shaped((self.eddy.whole_forms(distance)[0].coupling @ currents[..., None])[..., 0])

    def _exact(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        (at,) = self.eddy.whole_forms(distance)
        u = self._shaped((at.coupling @ currents[..., None])[..., 0])
        return np.asarray(self.static.field(distance, u) + (at.hall * currents).sum(axis=1))

    def _shaped(self, u: FloatArray) -> FloatArray:
        n = len(self.eddy.circuits)
        return (u if n > 1 else u[:, 0]) if n else np.zeros(len(u))

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
        value, _, by_current = self.static.derivatives(distance, self._shaped(np.zeros((len(distance), n))))
        by_circuit = by_current.reshape(len(distance), 1, -1)[..., :n]
        return np.concatenate([value[:, None], (by_circuit @ at.coupling)[:, 0] + at.hall], axis=1)


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
