"""A step's response at a distance as a table, for iron that does not saturate: no eigenvalues while it runs.

Where the co-energy is a quadratic form in all currents w, what :mod:`femfit.model.exponential_step` needs depends on
the distance alone: the force is F_0 + k_0 . w + w^T K w / 2, the motional constants k_0 + K w, and with the volts
b = U - R w + k_m (v + h a / 2)

    w+ = w + A b,  v+ = v + h a - (h/m) k_m . B b,  A = h f1(M) L^-1 = W (1 - exp(-z)) W^T,  B = W (1 - f1(z)) W^T,

with the modes W and decays z of :class:`femfit.model.decay.Decay`. All are smooth between the splines' knots.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.model.coenergy_matrix import CoenergyMatrix
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.decay import decay_of, decay_shares
from femfit.model.distance_table import DistanceTable, distance_table
from femfit.model.eddy_magnetics import EddyMagnetics
from femfit.model.magnetics import CoenergySpline, Magnetics
from femfit.model.windings import Windings


class Responses(NamedTuple):
    """At N distances, or their derivatives in d; the points come last."""

    force: FloatArray  # F_0 in N, shape (N,)
    motional_constant: FloatArray  # k_0 in N/A, shape (m, N)
    motional_slope: FloatArray  # K = -dL/dd in H/m, shape (m, m, N)
    both: FloatArray  # A and B in A/V, one below the other, shape (2 m, m, N)


@dataclass(frozen=True, eq=False)
class StepTable:
    """Responses over the distance, of one length of the step."""

    table: DistanceTable
    count: int  # m

    def values(self, distance: FloatArray, cell: IntArray) -> Responses:
        """At distances (N,) in the table's cells, as :class:`DistanceTable` takes them."""
        return self._parted(self.table.values(distance, cell))

    def slopes(self, distance: FloatArray, cell: IntArray) -> Responses:
        """Their derivatives in the distance."""
        return self._parted(self.table.slopes(distance, cell))

    def _parted(self, entries: FloatArray) -> Responses:
        m, points = self.count, entries.shape[1]
        first, second = 1 + m, 1 + m + m * m
        return Responses(
            entries[0],
            entries[1:first],
            entries[first:second].reshape(m, m, points),
            entries[second:].reshape(2 * m, m, points),
        )


def step_table(windings: Windings, step: float) -> StepTable | None:
    """The table for steps in s; None where there are no eddy currents, or where iron may saturate."""
    known = windings.step_tables
    if step not in known:
        known[step] = _made(windings, step)
    return known[step]


def _made(windings: Windings, step: float) -> StepTable | None:
    magnetics, m = windings.magnetics, windings.count
    if not isinstance(magnetics, EddyMagnetics):
        return None
    eddy, static = magnetics.eddy, _spline(magnetics.static)
    if static is None:
        return None
    middle = 0.5 * static[0].distance(static[1][[0, -1]]).sum()
    inductance = magnetics.inductance(middle, np.zeros(m)) + windings.series_H
    scale = 1.0 / np.sqrt(np.diag(inductance))  # currents of the same energy
    pairs = np.outer(scale, scale).ravel()
    kinds = (np.ones(1), scale, pairs, 1.0 / pairs, 1.0 / pairs)
    splines = (eddy.coordinate, eddy.u_knots), static
    return StepTable(distance_table(partial(_responses, windings, step), splines, kinds), m)


def _spline(static: Magnetics) -> tuple[DistanceCoordinate, FloatArray] | None:
    """Coordinate and knots of a co-energy that is quadratic in the currents; None of others."""
    if isinstance(static, CoenergyMatrix):
        return static.coordinate, static.u_knots
    if type(static) is CoenergySpline and static.spline.y_degree <= 2 and len(np.unique(static.spline.y_knots)) == 2:
        return static.coordinate, static.spline.x_knots
    return None


def _responses(windings: Windings, step: float, distance: FloatArray) -> FloatArray:
    """Entries (N, 1 + m + 3 m^2) as :class:`Responses` has them; NaN where an inductance is not positive."""
    m, points = windings.count, len(distance)
    at = windings.magnetics.slopes_of_circuits(distance, np.zeros((points, m)))
    decay = decay_of(at.inductance + windings.series_H, windings.resistances_ohm, step)
    first, _ = decay_shares(decay.z)
    shares = np.stack([first * decay.z, 1.0 - first], axis=1)
    both = (decay.modes[:, None] * shares[:, :, None]) @ np.swapaxes(decay.modes, -1, -2)[:, None]
    slope = -at.inductance_gradient.reshape(points, m * m)
    entries = np.concatenate([at.force[:, None], at.motional_constant, slope, both.reshape(points, 2 * m * m)], axis=1)
    entries[~(decay.z > 0.0).all(axis=1)] = np.nan
    return entries
