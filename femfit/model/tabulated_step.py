"""The step of :mod:`femfit.model.exponential_step` and its Jacobian by a table of responses.

Points are taken in the order of the table's cells and in blocks, a component's values together.
"""

from collections.abc import Iterator

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.distance_splines import FEW
from femfit.model.step_table import Responses, StepTable

BLOCK = 1024
"""Measured: points whose responses, of ten windings, stay in a processor's cache."""

Places = IntArray | slice


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
) -> FloatArray:
    """States (N, order) one step later; NaN where the table does not know the distance half way."""
    x, volts = state.T, _volts(model, voltage, len(state))
    mass, end = model.require_motion().mass_kg, model.windings.end
    result = np.empty(x.shape)
    for points, cell, middle in _blocks(table, x, step):
        if cell is None:
            result[:, points] = np.nan
            continue
        own = x[:, points] if isinstance(points, slice) else x.take(points, axis=1)
        at = _Point(model, table.values(middle, cell), middle, own, volts[:, points], step)
        moved = own.copy()
        moved[1] += step * at.acceleration - step / mass * np.einsum("jn,jn->n", at.motional_constant, at.lever)
        moved[0] += 0.5 * step * (own[1] + moved[1])
        moved[2:end] += at.change
        result[:, points] = moved
    return result.T


def tabulated_kick(
    model: ActuatorModel, table: StepTable, state: FloatArray, voltage: FloatArray, step: float
) -> FloatArray:
    """Derivatives of velocity and currents after a step by the state half way, (N, order, order).

    NaN where the table does not know the distance half way; the other rows are those of one.
    """
    x, volts, windings, motion = state.T, _volts(model, voltage, len(state)), model.windings, model.require_motion()
    m, end, half = windings.count, windings.end, 0.5 * step
    result = np.zeros((len(x), len(x), len(state)))
    result[range(len(x)), range(len(x))] = 1.0
    for points, cell, middle in _blocks(table, x, step):
        if cell is None:
            result[1:end, :, points] = np.nan
            continue
        own = x[:, points] if isinstance(points, slice) else x.take(points, axis=1)
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
    return result.transpose(2, 0, 1)


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Products at each point: (j, k, N) and (k, N) -> (j, N)."""
    return np.asarray(np.einsum("jkn,kn->jn", matrix, vector))


def _volts(model: ActuatorModel, voltage: FloatArray, points: int) -> FloatArray:
    """Voltages of the circuits, (n, N)."""
    n = model.windings.circuits
    if n == 1 and np.shape(voltage) == (points,):
        return np.asarray(voltage)[None]
    return np.broadcast_to(np.asarray(voltage)[..., None] if n == 1 else voltage, (points, n)).T


def _blocks(table: StepTable, state: FloatArray, step: float) -> Iterator[tuple[Places, IntArray | None, FloatArray]]:
    """Places of points, their cells and distances half way, cell by cell; first those of no cell, as None."""
    middle = state[0] + 0.5 * step * state[1]
    cell = table.table.cell(middle)
    if len(cell) <= FEW and cell.min(initial=0) >= 0:
        yield slice(None), cell, middle
        return
    order = np.argsort(cell.astype(np.int16), kind="stable")
    without = int(np.count_nonzero(cell < 0))
    if without:
        yield order[:without], None, middle[order[:without]]
    for first in range(without, len(order), BLOCK):
        points = order[first : first + BLOCK]
        yield points, cell[points], middle[points]
