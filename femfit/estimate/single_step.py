"""One step of one unscented filter, in Python's floats or, of models that move by arrays alone, in those.

The equations are those of :class:`femfit.estimate.kalman_filter.UnscentedFilter`, with redrawn points, in the same
order. For three or four states and one run, calls to numpy would cost several times the arithmetic; a target's
control loop runs one filter. A step in which anything must be named (a lost covariance, a number that is none, an
estimate outside of the model) is left to the general path, which names it.
"""

from functools import cache
from itertools import chain
from math import isnan
from operator import mul
from typing import NamedTuple

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.estimate.cholesky import cholesky_rows
from femfit.estimate.process import Columns, FilterProcess


class SingleStep(NamedTuple):
    """What one step came to."""

    numbers: FloatArray  # Covariance and factor row by row, then the mean
    innovations: list[float]  # NaN for a sample that is missing
    variances: list[float]


def single_step(
    process: FilterProcess,
    mean: list[float],
    factor: list[list[float]],
    voltage: float | FloatArray,
    measurement: list[float],
    scaling: tuple[float, float, float],
) -> SingleStep | None:
    """Predict and update; None where a run is not healthy.

    Parameters
    ----------
    measurement : list of float
        A reading of each sensor.
    scaling : (float, float, float)
        Spread of the points, weight of each, and weight of the squared shift.
    """
    spread, weight, shift_weight = scaling
    order = len(mean)
    moved = process.move(_points(mean, factor, spread), voltage)
    mean, deltas, shifts, covariance = [], [], [], []
    for column, noise in zip(moved, process.noise_rows, strict=True):
        centre = column[0]
        delta = [value - centre for value in column[1:]]
        shift = weight * sum(delta)
        scaled = shift_weight * shift
        mean.append(centre + shift)
        deltas.append(delta)
        shifts.append(shift)
        row = []
        for other, other_shift, q in zip(deltas, shifts, noise):  # noqa: B905  the lower triangle
            row.append(weight * sum(map(mul, delta, other)) + scaled * other_shift + q)
        covariance.append(row)
    predicted = cholesky_rows(covariance)
    if predicted is None or not process.is_plausible(mean):
        return None
    innovations, variances = [], []
    for output, reading in zip(process.outputs, measurement, strict=True):
        if isnan(reading):
            innovations.append(reading)
            variances.append(reading)
            continue
        values = output.look(_points(mean, predicted, spread))
        centre = values[0]
        delta = [value - centre for value in values[1:]]
        shift = weight * sum(delta)
        variance = weight * sum(map(mul, delta, delta)) + shift_weight * shift * shift + output.variance
        innovation = reading - (centre + shift)
        # Redrawn points lie in pairs about the mean: mean +- spread L_k, of which only the difference in z remains.
        pairs = [weight * spread * (up - down) for up, down in zip(delta[:order], delta[order:], strict=True)]
        cross, correction = [], innovation / variance
        for k, row in enumerate(covariance):
            own = sum(map(mul, predicted[k], pairs))
            cross.append(own)
            mean[k] += own * correction
            for j, other_cross in enumerate(cross):
                row[j] -= own * other_cross / variance
        updated = cholesky_rows(covariance)
        if updated is None or not process.is_plausible(mean):
            return None
        predicted = updated
        innovations.append(innovation)
        variances.append(variance)
    for i, row in enumerate(covariance):
        for below in covariance[i + 1 :]:
            row.append(below[i])
    return SingleStep(np.array([*chain(*covariance, *predicted), *mean]), innovations, variances)


def single_step_by_arrays(
    process: FilterProcess,
    mean: FloatArray,
    factor: FloatArray,
    voltage: float | FloatArray,
    measurement: list[float],
    scaling: tuple[float, float, float],
) -> SingleStep | None:
    """The same of more states; arguments as of :func:`single_step`, in arrays."""
    spread, weight, shift_weight = scaling
    order = len(mean)
    points = _array_points(mean, factor, spread)
    count = 2 * order + 1
    inputs = np.full(count, voltage) if isinstance(voltage, float) else np.full((count, *voltage.shape), voltage)
    moved = process.transition(points.T, inputs).T
    delta = moved[:, 1:] - moved[:, :1]
    shift = weight * np.add.reduce(delta, 1)
    mean = moved[:, 0] + shift
    covariance = weight * (delta @ delta.T) + shift_weight * (shift[:, None] * shift) + process.process_covariance
    innovations, variances = [], []
    try:
        factor = np.linalg.cholesky(covariance)
        if not process.is_plausible(mean.tolist()):
            return None
        for output, reading in zip(process.outputs, measurement, strict=True):
            if isnan(reading):
                innovations.append(reading)
                variances.append(reading)
                continue
            values = output.measure(_array_points(mean, factor, spread).T)
            seen = values[1:] - values[0]
            risen = weight * float(seen.sum())
            variance = weight * float(seen @ seen) + shift_weight * risen * risen + output.variance
            innovation = reading - (float(values[0]) + risen)
            cross = factor @ (weight * spread * (seen[:order] - seen[order:]))
            mean = mean + cross * (innovation / variance)
            covariance = covariance - cross[:, None] * (cross / variance)
            factor = np.linalg.cholesky(covariance)
            if not process.is_plausible(mean.tolist()):
                return None
            innovations.append(innovation)
            variances.append(variance)
    except np.linalg.LinAlgError:
        return None
    return SingleStep(np.concatenate([covariance.ravel(), factor.ravel(), mean]), innovations, variances)


@cache
def _spreads(order: int, spread: float) -> FloatArray:
    """Sigma points of no mean and a unit factor, the centre first, shape (n, 2 n + 1)."""
    unit = spread * np.eye(order)
    return np.concatenate([np.zeros((order, 1)), unit, -unit], axis=1)


def _array_points(mean: FloatArray, factor: FloatArray, spread: float) -> FloatArray:
    return np.asarray(mean[:, None] + factor @ _spreads(len(mean), spread))


def _points(mean: list[float], factor: list[list[float]], spread: float) -> Columns:
    """Sigma points about a mean, the centre first; one list a state."""
    columns = []
    for centre, row in zip(mean, factor, strict=True):
        above, below = [centre], []
        for entry in row:
            offset = spread * entry
            above.append(centre + offset)
            below.append(centre - offset)
        columns.append(above + below)
    return columns
