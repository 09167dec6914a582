"""One step of one filter, predict and update, as one function: what a control loop calls.

The equations are those of :mod:`femfit.estimate.kalman_filter`, in the same order. A reading that is missing has an
infinite variance, so that it changes nothing.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from femfit.core.compiled import Compilation
from femfit.core.numerics import FloatArray
from femfit.core.tape import Caller
from femfit.estimate.process import FilterProcess
from femfit.estimate.process_graph import ProcessGraph, scalar_functions

MISSING = 1e200
"""Numerical: variance of a reading that is missing."""

MOST_WRITTEN = 40_000
"""Measured: instructions up to which all sigma points are written out; a larger step is called as a function."""


class SingleStep(NamedTuple):
    """What one step came to."""

    covariance: FloatArray  # (n, n)
    factor: FloatArray
    mean: FloatArray  # (n,)
    predicted: FloatArray  # The mean before the readings
    innovations: FloatArray  # Of each sensor
    variances: FloatArray


class StepFunction:
    """(mean, covariance or factor, voltages, readings, their variances) -> :class:`SingleStep`.

    ``function`` is that of CasADi, whose output has the parts one below the other, matrices column by column.
    """

    def __init__(self, process: FilterProcess, graph: ProcessGraph, make: Callable[..., list[Any]]) -> None:
        functions = scalar_functions(graph, [output.name for output in process.outputs])
        n, m = graph.order, len(process.outputs)
        points = 1 if make is extended else 2 * n + 1
        written = points * sum(function.n_instructions() for function in functions[::2]) < MOST_WRITTEN
        symbol: Any = ca.SX if written and all(function.is_a("SXFunction") for function in functions) else ca.MX
        shapes = (("x", n), ("P", n, n), ("u", len(graph.model.circuits)), ("y", m), ("R", m))
        given = [symbol.sym(*shape) for shape in shapes]
        parts = make(functions, ca.DM(process.process_covariance), *given)
        output = ca.vertcat(*(ca.vec(ca.densify(part)) for part in parts))
        function = ca.Function("step", given, [ca.cse(output) if symbol is ca.SX else output])
        self.function = function
        self._call, self._order, self._sensors = Caller(function, Compilation(function)), n, m
        self._variances = np.array([output.variance for output in process.outputs])

    def __call__(self, mean: FloatArray, matrix: FloatArray, voltage: Any, readings: FloatArray) -> SingleStep:
        """One step; ``matrix`` is symmetric, or a factor as its transpose."""
        n, m = self._order, self._sensors
        missing = np.isnan(readings)
        y, r = (
            (np.where(missing, 0.0, readings), np.where(missing, MISSING, self._variances))
            if missing.any()
            else (readings, self._variances)
        )
        values = self._call(mean, matrix.ravel(), voltage, y, r)
        square, ends = n * n, 2 * n * n + 2 * n
        innovations, variances = values[ends : ends + m], values[ends + m :]
        if missing.any():
            innovations, variances = np.where(missing, np.nan, innovations), np.where(missing, np.nan, variances)
        return SingleStep(
            values[:square].reshape(n, n),
            values[square : 2 * square].reshape(n, n).T,
            values[2 * square : ends - n],
            values[ends - n : ends],
            innovations,
            variances,
        )


def _factor(covariance: Any) -> Any:
    """L of L L^T, with NaN where there is none."""
    square = ca.SX.sym("P", *covariance.shape)
    return ca.Function("factor", [square], [ca.densify(ca.chol(square).T)])(covariance)


def extended(functions: Sequence[ca.Function], noise: Any, x: Any, P: Any, u: Any, y: Any, R: Any) -> list[Any]:
    """The extended filter: the covariance follows the Jacobians; Joseph's form."""
    step, step_slope, look, look_slope = functions
    n, m = x.numel(), y.numel()
    F = ca.reshape(step_slope(x, u), n, n)
    mean = predicted = step(x, u)
    covariance = F @ P @ F.T + noise
    innovations, variances = [], []
    for k in range(m):
        H = ca.reshape(look_slope(mean, u), m, n)[k, :]
        cross = covariance @ H.T
        variance = H @ cross + R[k]
        gain, innovation = cross / variance, y[k] - look(mean, u)[k]
        mean, kept = mean + gain * innovation, type(x).eye(n) - gain @ H
        covariance = kept @ covariance @ kept.T + R[k] * gain @ gain.T
        covariance = 0.5 * (covariance + covariance.T)
        innovations.append(innovation)
        variances.append(variance)
    return [covariance, _factor(covariance), mean, predicted, *innovations, *variances]


def unscented(
    scaling: tuple[float, float, float],
    functions: Sequence[ca.Function],
    noise: Any,
    x: Any,
    S: Any,
    u: Any,
    y: Any,
    R: Any,
) -> list[Any]:
    """The unscented filter with redrawn points; S S^T is the covariance."""
    (spread, weight, shift_weight), (step, _, look, _) = scaling, functions
    n = x.numel()

    def points(mean: Any, factor: Any) -> list[Any]:
        return [mean, *(mean + sign * spread * factor[:, k] for sign in (1.0, -1.0) for k in range(n))]

    def moments(values: list[Any]) -> tuple[Any, Any]:
        delta = ca.horzcat(*(value - values[0] for value in values[1:]))
        return delta, weight * ca.sum2(delta)

    moved = [step(point, u) for point in points(x, S)]
    delta, shift = moments(moved)
    mean = predicted = moved[0] + shift
    covariance = weight * delta @ delta.T + shift_weight * shift @ shift.T + noise
    factor = _factor(covariance)
    innovations, variances = [], []
    for k in range(y.numel()):
        seen = [look(point, u)[k] for point in points(mean, factor)]
        delta, shift = moments(seen)
        variance = weight * delta @ delta.T + shift_weight * shift**2 + R[k]
        # Redrawn points lie in pairs about the mean: mean +- spread L_k, of which only the difference in z remains
        cross = factor @ (weight * spread * (delta[:n] - delta[n:]).T)
        innovation = y[k] - seen[0] - shift
        mean, covariance = mean + cross * (innovation / variance), covariance - cross @ cross.T / variance
        factor = _factor(covariance)
        innovations.append(innovation)
        variances.append(variance)
    return [covariance, factor, mean, predicted, *innovations, *variances]
