"""The equations of a filter on one process: over arrays for many runs, and as one function of one step of one run.

A control loop calls the one function. A reading that is missing has an infinite variance there, so that it changes
nothing.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from femfit.core.graph import GraphFunction
from femfit.core.numerics import FloatArray
from femfit.estimate.process import FilterProcess

if TYPE_CHECKING:
    from femfit.estimate.filter import Filter

MISSING = 1e200
"""Numerical: variance of a reading that is missing."""

MOST_WRITTEN = 40_000
"""Numerical: instructions up to which all sigma points are written out; a larger step is called as a function."""


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
    read: Callable[[int, Any], Any]  # (number of a sensor, points) -> a row of readings
    read_slope: Callable[[int, Any], Any]  # dh/dx of one state, a row


def in_arrays(process: FilterProcess) -> Terms:
    """The terms for many runs."""

    def as_points(values: FloatArray, points: FloatArray) -> FloatArray:
        """Values (N, k), or (N,), of points (n, count, runs)."""
        return np.ascontiguousarray(values.T).reshape(-1, *points.shape[1:])

    def moved(points: FloatArray, inputs: FloatArray) -> FloatArray:
        every = np.concatenate([inputs] * points.shape[1])
        return as_points(process.transition(points.reshape(len(points), -1).T, every), points)

    def moved_with_slope(state: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        after, slope = process.with_slopes(state[:, 0].T, inputs)
        return as_points(after, state), slope.transpose(1, 2, 0)

    def read(sensor: int, points: FloatArray) -> FloatArray:
        return as_points(process.measure(process.outputs[sensor].name, points.reshape(len(points), -1).T), points)

    return Terms(
        product=lambda a, b: np.einsum("ijr,jkr->ikr", a, b),
        turned=lambda a: a.swapaxes(0, 1),
        beside=lambda *parts: np.concatenate(parts, axis=1),
        total=lambda a: a.sum(axis=1, keepdims=True),
        unit=np.eye(process.order)[:, :, None],
        noise=process.process_covariance[:, :, None],
        moved=moved,
        moved_with_slope=moved_with_slope,
        read=read,
        read_slope=lambda sensor, state: process.gradient(process.outputs[sensor].name, state[:, 0].T).T[None],
    )


def step_function(filter_: "Filter", *, compact: bool = False, floor: float = 0.0) -> ca.Function:
    """(mean, factor, voltages, readings, their variances) -> one step of one run.

    The output has covariance, factor, mean, mean before the readings, innovations and their variances one below the
    other, matrices column by column. Where it is to be compact, sigma points call one function that looks its tables
    up: a third of the code in C.

    Parameters
    ----------
    floor : float
        Least square of a factor's pivot over the variance, where rounding may leave none.
    """
    process, unscented = filter_.process, filter_.is_unscented
    n, m = process.order, len(process.outputs)

    def made(function: GraphFunction) -> ca.Function:
        return function.by_tables if compact and unscented else function.at_a_point

    moves = [made(process.step(first=first)) for first in process.steps]
    looks = [made(process.reading(output.name)) for output in process.outputs]
    count = sum(function.n_instructions() for function in (*moves, *looks)) * (2 * n + 1 if unscented else 1)
    plain = all(function.is_a("SXFunction") for function in (*moves, *looks))  # then slopes are, of the same rows
    symbol: Any = ca.SX if plain and count < MOST_WRITTEN and not (compact and unscented) else ca.MX
    shapes = (("x", n), ("L", n, n), ("u", process.inputs), ("y", m), ("R", m))
    x, factor, u, y, r = symbols = [symbol.sym(*shape) for shape in shapes]

    def moved(points: Any, u: Any) -> Any:
        columns = ca.horzsplit(points)
        for move in moves:
            columns = [move(point, u) for point in columns]
        return ca.horzcat(*columns)

    def moved_with_slope(x: Any, u: Any) -> tuple[Any, Any]:
        slope = symbol.eye(n)
        for first in process.steps:
            x, columns = ca.vertsplit(made(process.step(first=first, slopes=True))(x, u), [0, n, n + n * n])
            slope = ca.reshape(columns, n, n) @ slope
        return x, slope

    def read_slope(sensor: int, x: Any) -> Any:
        return made(process.reading(process.outputs[sensor].name, slopes=True))(x, u)[1:].T

    terms = Terms(
        product=ca.mtimes,
        turned=lambda a: a.T,
        beside=ca.horzcat,
        total=ca.sum2,
        unit=symbol.eye(n),
        noise=ca.DM(process.process_covariance),
        moved=moved,
        moved_with_slope=moved_with_slope,
        read=lambda sensor, points: ca.horzcat(*(looks[sensor](point, u) for point in ca.horzsplit(points))),
        read_slope=read_slope,
    )
    mean, covariance = filter_.predicted(terms, x, ca.tril(factor) if symbol is ca.SX else factor, u)
    predicted, innovations, variances = mean, [], []
    for k in range(m):
        before = mean, covariance, _factor(covariance, floor)
        mean, covariance, innovation, variance = filter_.corrected(terms, k, before, y[k], r[k])
        innovations.append(innovation)
        variances.append(variance)
    symmetric = ca.tril2symm(ca.tril(covariance)) if symbol is ca.SX else covariance
    parts = [symmetric, _factor(covariance, floor), mean, predicted, *innovations, *variances]
    output = ca.vertcat(*(ca.vec(ca.densify(output_part)) for output_part in parts))
    return ca.Function("f", symbols, [ca.cse(output) if symbol is ca.SX else output])


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
