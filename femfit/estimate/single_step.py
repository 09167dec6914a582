"""The equations of a filter on one process: over arrays for many runs, and as one function of one step of one run.

A control loop calls the one function. A reading that is missing has an infinite variance there, so that it changes
nothing.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from femfit.core.compiled import Compilation
from femfit.core.graph import GraphFunction
from femfit.core.numerics import FloatArray
from femfit.core.tape import Caller
from femfit.estimate.process import FilterProcess, Output

if TYPE_CHECKING:
    from femfit.estimate.filter import Filter

MISSING = 1e200
"""Numerical: variance of a reading that is missing."""

MOST_WRITTEN = 40_000
"""Measured: instructions up to which all sigma points are written out; a larger step is called as a function."""


class Terms(NamedTuple):
    """What a filter's equations are made of: matrices as arrays (rows, columns, runs), or as expressions.

    States are columns; sigma points lie side by side.
    """

    product: Callable[[Any, Any], Any]
    turned: Callable[[Any], Any]
    beside: Callable[..., Any]
    total: Callable[[Any], Any]  # Of a matrix's columns
    unit: Any
    noise: Any  # Q
    moved: Callable[[Any, Any], Any]  # (points, inputs) -> points one sample later
    moved_with_slope: Callable[[Any, Any], tuple[Any, Any]]  # Of one state, and df/dx
    read: Sequence[Callable[[Any], Any]]  # Of each sensor: points -> a row of readings
    read_slope: Sequence[Callable[[Any], Any]]  # dh/dx of one state, a row


def in_arrays(process: FilterProcess) -> Terms:
    """The terms for many runs."""

    def as_points(values: FloatArray, points: FloatArray) -> FloatArray:
        """Values (N, k), or (N,), of points (n, count, runs)."""
        return np.ascontiguousarray(values.T).reshape(-1, *points.shape[1:])

    def moved(points: FloatArray, inputs: FloatArray) -> FloatArray:
        every = np.empty((points.shape[1], *inputs.shape))
        every[:] = inputs
        states = points.reshape(len(points), -1).T
        return as_points(process.transition(states, every.reshape(len(states), *inputs.shape[1:])), points)

    def moved_with_slope(state: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        after, slope = process.with_slopes(state[:, 0].T, inputs)
        return as_points(after, state), slope.transpose(1, 2, 0)

    def reading(output: Output, points: FloatArray) -> FloatArray:
        return as_points(process.measure(output.name, points.reshape(len(points), -1).T), points)

    def reading_slope(output: Output, points: FloatArray) -> FloatArray:
        return process.gradient(output.name, points[:, 0].T).T[None]

    return Terms(
        product=lambda a, b: np.einsum("ijr,jkr->ikr", a, b),
        turned=lambda a: a.swapaxes(0, 1),
        beside=lambda *parts: np.concatenate(parts, axis=1),
        total=lambda a: a.sum(axis=1, keepdims=True),
        unit=np.eye(process.order)[:, :, None],
        noise=process.process_covariance[:, :, None],
        moved=moved,
        moved_with_slope=moved_with_slope,
        read=[partial(reading, output) for output in process.outputs],
        read_slope=[partial(reading_slope, output) for output in process.outputs],
    )


class SingleStep(NamedTuple):
    """What one step came to."""

    covariance: FloatArray  # (n, n)
    factor: FloatArray
    mean: FloatArray  # (n,)
    predicted: FloatArray  # The mean before the readings
    innovations: FloatArray  # Of each sensor
    variances: FloatArray


class StepFunction:
    """(mean, factor, voltages, readings, their variances) -> :class:`SingleStep`.

    ``function`` is that of CasADi, whose output has the parts one below the other, matrices column by column. Where it
    is to be compact, sigma points call one function that looks its tables up: a third of the code in C.

    Parameters
    ----------
    floor : float
        Least square of a factor's pivot over the variance, where rounding may leave none.
    """

    def __init__(self, filter_: "Filter", *, compact: bool = False, floor: float = 0.0) -> None:
        graph = filter_.process
        outputs, n = filter_.process.outputs, graph.order
        m = len(outputs)
        points = 2 * n + 1 if filter_.is_unscented else 1
        compact = compact and points > 1

        def made(function: GraphFunction) -> ca.Function:
            return function.by_tables if compact else function.at_a_point

        moves = [made(graph.step(first=first)) for first in graph.steps]
        looks = [made(graph.reading(output.name)) for output in outputs]
        count = points * sum(function.n_instructions() for function in (*moves, *looks))
        written = count < MOST_WRITTEN and not compact
        plain = all(function.is_a("SXFunction") for function in (*moves, *looks))  # then slopes are, of the same rows
        symbol: Any = ca.SX if written and plain else ca.MX
        shapes = (("x", n), ("L", n, n), ("u", len(graph.model.circuits)), ("y", m), ("R", m))
        x, factor, u, y, r = given = [symbol.sym(*shape) for shape in shapes]

        def of_each(function: ca.Function, points: Any) -> Any:
            return ca.horzcat(*(function(point, u) for point in ca.horzsplit(points)))

        def moved(x: Any) -> Any:
            for move in moves:
                x = move(x, u)
            return x

        def moved_with_slope(x: Any, _: Any) -> tuple[Any, Any]:
            result = symbol.eye(n)
            for first in graph.steps:
                x, columns = ca.vertsplit(made(graph.step(first=first, slopes=True))(x, u), [0, n, n + n * n])
                result = ca.reshape(columns, n, n) @ result
            return x, result

        def read_slope(name: str, x: Any) -> Any:
            return ca.reshape(made(graph.reading(name, slopes=True))(x, u), -1, n)

        terms = Terms(
            product=ca.mtimes,
            turned=lambda a: a.T,
            beside=ca.horzcat,
            total=ca.sum2,
            unit=symbol.eye(n),
            noise=ca.DM(filter_.process.process_covariance),
            moved=lambda points, _: ca.horzcat(*map(moved, ca.horzsplit(points))),
            moved_with_slope=moved_with_slope,
            read=[partial(of_each, look) for look in looks],
            read_slope=[partial(read_slope, output.name) for output in outputs],
        )
        mean, covariance = filter_.predicted(terms, x, ca.tril(factor) if symbol is ca.SX else factor, u)
        predicted, seen = mean, []
        for k in range(m):
            factor = _factor(covariance, floor)
            mean, covariance, *judged = filter_.corrected(terms, k, (mean, covariance, factor), y[k], r[k])
            seen.append(judged)
        whole = ca.tril2symm(ca.tril(covariance)) if symbol is ca.SX else covariance
        parts = [whole, _factor(covariance, floor), mean, predicted, *(a for a, _ in seen), *(b for _, b in seen)]
        output = ca.vertcat(*(ca.vec(ca.densify(part)) for part in parts))
        function = ca.Function("f", given, [ca.cse(output) if symbol is ca.SX else output])
        self.function = function
        self._call, self._order, self._sensors = Caller(function, Compilation(lambda: function)), n, m
        self._variances = np.array([output.variance for output in outputs])

    def __call__(self, mean: FloatArray, factor: FloatArray, voltage: Any, readings: FloatArray) -> SingleStep:
        """One step; ``factor`` is its transpose."""
        n, m = self._order, self._sensors
        missing = np.isnan(readings)
        y, r = (
            (np.where(missing, 0.0, readings), np.where(missing, MISSING, self._variances))
            if missing.any()
            else (readings, self._variances)
        )
        values = self._call(mean, factor.ravel(), voltage, y, r)
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


def _factor(covariance: Any, floor: float) -> Any:
    """L of L L^T, with NaN where there is none; squares of its pivots are no less than a part of the variances."""
    square = ca.SX.sym("P", *covariance.shape)
    factor = ca.SX.zeros(*covariance.shape)
    for j in range(square.shape[0]):
        column = square[j:, j] - factor[j:, :j] @ factor[j, :j].T
        pivot = ca.sqrt(ca.fmax(column[0], floor * square[j, j]) if floor else column[0])
        factor[j:, j] = column / pivot
        factor[j, j] = pivot
    return ca.Function("factor", [square], [factor])(covariance)
