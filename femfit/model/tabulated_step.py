"""The step of :mod:`femfit.model.exponential_step` and its Jacobian by a table of responses.

Points are taken in the order of the table's cells and in blocks, a component's values together.

A step's response at a distance as a table, for iron that does not saturate: no eigenvalues while it runs.

Where the co-energy is a quadratic form in all currents w, what :mod:`femfit.model.exponential_step` needs depends on
the distance alone: the force is F_0 + k_0 . w + w^T K w / 2, the motional constants k_0 + K w, and with the volts
b = U - R w + k_m (v + h a / 2)

    w+ = w + A b,  v+ = v + h a - (h/m) k_m . B b,  A = h f1(M) L^-1 = W (1 - exp(-z)) W^T,  B = W (1 - f1(z)) W^T,

with the modes W and decays z of :class:`femfit.model.windings.Decay`. All are smooth between the splines' knots.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from femfit.core.numerics import FloatArray, IntArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.distance_table import DistanceTable, distance_table
from femfit.model.eddy_magnetics import EddyMagnetics
from femfit.model.magnetics import CoenergySpline, Magnetics
from femfit.model.several_magnetics import CoenergyMatrix
from femfit.model.windings import Windings, decay_of, decay_shares


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
    at = windings.magnetics.slopes(distance, np.zeros((points, m)))
    decay = decay_of(at.inductance + windings.series_H, windings.resistances_ohm, step)
    first, _ = decay_shares(decay.z)
    shares = np.stack([first * decay.z, 1.0 - first], axis=1)
    both = (decay.modes[:, None] * shares[:, :, None]) @ np.swapaxes(decay.modes, -1, -2)[:, None]
    slope = -at.inductance_gradient.reshape(points, m * m)
    entries = np.concatenate([at.force[:, None], at.motional_constant, slope, both.reshape(points, 2 * m * m)], axis=1)
    entries[~(decay.z > 0.0).all(axis=1)] = np.nan
    return entries


BLOCK = 1024
"""Measured: points whose responses, of ten windings, stay in a processor's cache."""


class _Point:
    """What a step comes to at N points half way, from their states (order, N) and volts (m, N)."""

    def __init__(
        self, model: ActuatorModel, at: Responses, middle: FloatArray, state: FloatArray, volts: FloatArray, step: float
    ) -> None:
        motion, windings = model.require_motion(), model.windings
        self.currents = w = state[2 : windings.end]
        self.motional_constant = k = at.motional_constant + _times(at.motional_slope, w)
        force = at.force + 0.5 * np.einsum("jn,jn->n", at.motional_constant + k, w)
        self.acceleration = motion.acceleration(middle, state[1], force, model.sample_time_s)
        self.seen = state[1] + 0.5 * step * self.acceleration
        self.driving = k * self.seen - windings.resistances_ohm[:, None] * w
        self.driving[: windings.circuits] += volts
        both = _times(at.both, self.driving)
        self.change, self.lever = both[: windings.count], both[windings.count :]


def tabulated_step(
    model: ActuatorModel, table: StepTable, state: FloatArray, voltage: FloatArray, step: float
) -> tuple[FloatArray, IntArray]:
    """States (N, order) one step later, and the places of those half way to a distance beyond the table."""
    x, volts = state.T, _volts(model, voltage, len(state))
    middle = x[0] + 0.5 * step * x[1]
    beyond, inside, cell = table.table.in_order(middle)
    if isinstance(inside, slice):
        return _moved(model, table.values(middle, cell), middle, x, volts, step).T, beyond
    result = np.empty(x.shape)
    for points, cells in _blocks(inside, cell):
        at, there = middle[points], x[:, points]
        result[:, points] = _moved(model, table.values(at, cells), at, there, volts[:, points], step)
    return result.T, beyond


def _moved(
    model: ActuatorModel, here: Responses, middle: FloatArray, state: FloatArray, volts: FloatArray, step: float
) -> FloatArray:
    """States (order, N) one step later."""
    at, mass = _Point(model, here, middle, state, volts, step), model.require_motion().mass_kg
    result = state.copy()
    result[1] += step * at.acceleration - step / mass * np.einsum("jn,jn->n", at.motional_constant, at.lever)
    result[0] += 0.5 * step * (state[1] + result[1])
    result[2 : model.windings.end] += at.change
    return result


def tabulated_kick(
    model: ActuatorModel, table: StepTable, state: FloatArray, voltage: FloatArray, step: float
) -> tuple[FloatArray, IntArray]:
    """Derivatives of velocity and currents after a step by the state half way, and the places beyond the table.

    Of shape (N, order, order), with ones for the other states.
    """
    x, volts, windings, motion = state.T, _volts(model, voltage, len(state)), model.windings, model.require_motion()
    m, end, half = windings.count, windings.end, 0.5 * step
    result = np.zeros((len(x), len(x), len(state)))
    result[range(len(x)), range(len(x))] = 1.0
    half_way = x[0] + half * x[1]
    beyond, inside, cells = table.table.in_order(half_way)
    for points, cell in _blocks(inside, cells):
        middle, own = half_way[points], x[:, points]
        here, rising = table.values(middle, cell), table.slopes(middle, cell)
        at = _Point(model, here, middle, own, volts[:, points], step)
        w, k = at.currents, at.motional_constant
        k_slope = rising.motional_constant + _times(rising.motional_slope, w)
        gradient = rising.force + 0.5 * ((rising.motional_constant + k_slope) * w).sum(axis=0)
        row = np.concatenate([[motion.static_gradient(middle) - gradient], -k])  # of the acceleration, by d and w
        row /= motion.mass_kg
        by_velocity = motion.friction_slope(own[1], model.sample_time_s) / motion.mass_kg
        driving = half * k[:, None] * row  # of the volts, by d and w
        driving[:, 0] += k_slope * at.seen
        driving[:, 1:] += here.motional_slope * at.seen
        driving[range(m), range(1, m + 1)] -= windings.resistances_ohm[:, None]
        answer = np.einsum("jkn,kln->jln", here.both, driving)
        answer[:, 0] += _times(rising.both, at.driving)
        answered = _times(here.both, k) * (1.0 + half * by_velocity)
        pull = np.einsum("kn,kln->ln", k, answer[m:])
        pull[0] += (k_slope * at.lever).sum(axis=0)
        pull[1:] += _times(here.motional_slope, at.lever)
        by_others = [0, *range(2, end)]
        found = np.zeros((end - 1, end, middle.size))
        found[0, by_others] = step * (row - pull / motion.mass_kg)
        found[0, 1] = step * (by_velocity - (k * answered[m:]).sum(axis=0) / motion.mass_kg)
        found[1:, by_others] = answer[:m]
        found[1:, 1] = answered[:m]
        result[1:end, :end, points] += found
    return result.transpose(2, 0, 1), beyond


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Products at each point: (j, k, N) and (k, N) -> (j, N)."""
    return np.asarray(np.einsum("jkn,kn->jn", matrix, vector))


def _volts(model: ActuatorModel, voltage: FloatArray, points: int) -> FloatArray:
    """Voltages of the circuits, (n, N)."""
    n = model.windings.circuits
    if n == 1 and np.shape(voltage) == (points,):
        return np.asarray(voltage)[None]
    return np.broadcast_to(np.asarray(voltage)[..., None] if n == 1 else voltage, (points, n)).T


def _blocks(points: IntArray | slice, cell: IntArray) -> Iterator[tuple[IntArray | slice, IntArray]]:
    """Places and cells of so many points as stay in a processor's cache."""
    if isinstance(points, slice):
        yield points, cell
        return
    for first in range(0, len(points), BLOCK):
        yield points[first : first + BLOCK], cell[first : first + BLOCK]
