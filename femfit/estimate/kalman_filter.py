"""A Kalman filter for a model, ready to start.

The unscented Kalman filter with control input, the paper's (19) to (31), in difference form.

With delta_i = Y_i - Y_0 and s = sum_i W_i delta_i, the weighted mean is Y_0 + s, and the weighted covariance about it
is sum_{i>0} W_i delta_i delta_i^T + (2 - alpha^2) s s^T: the centre weight, -2.5e5 for alpha = 0.002, has cancelled
algebraically, so that it cannot cancel numerically. New points are drawn for the update, so that they contain Q.

Points are arrays of shape (n, 2n + 1, runs), the centre first: what is computed for all runs at once lies together in
memory.

The extended Kalman filter: the covariance follows the Jacobians of transition and measurement.

The Jacobians are analytic where the process has them (the levitation process does, from the model's own derivatives)
and central differences otherwise. The covariance is updated in Joseph's form, which keeps it positive definite.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (19) to (31).
S. J. Julier and J. K. Uhlmann, Proc. IEEE 92 (2004) 401.
S. J. Julier, The scaled unscented transformation, American Control Conference (2002) 4555.
D. Simon, Optimal State Estimation (Wiley, 2006), sections 13.2 and 5.2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import sqrt
from pathlib import Path
from typing import ClassVar, Literal, final

import numpy as np

from femfit.core.errors import FilterError
from femfit.core.numerics import FloatArray
from femfit.estimate.filter import Correction, Filter, Moments
from femfit.estimate.levitation import levitation_process
from femfit.estimate.noise import FilterNoise
from femfit.estimate.process import FilterState, Output
from femfit.estimate.process_graph import ProcessGraph
from femfit.estimate.single_step import StepFunction, extended, unscented
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of


@final
@dataclass(frozen=True, eq=False, repr=False)
class ExtendedFilter(Filter):
    """Extended Kalman filter; parameters as in :class:`Filter`."""

    title: ClassVar[str] = "extended Kalman filter"

    def _predicted(self, state: FilterState, voltage: FloatArray) -> Moments:
        dtype = state.mean.dtype
        mean = self.process.transition(state.mean, voltage).astype(dtype, copy=False)
        jacobian = self.process.state_jacobian(state.mean, voltage).astype(dtype, copy=False)
        covariance = jacobian @ state.covariance @ jacobian.swapaxes(1, 2)
        return Moments(mean, covariance + self.process.process_covariance.astype(dtype, copy=False))

    def _corrected(self, state: FilterState, measurement: FloatArray, output: Output) -> Correction:
        dtype, noise = state.mean.dtype, output.variance
        predicted = output.measure(state.mean).astype(dtype, copy=False)
        slope = self.process.output_jacobian(state.mean, output).astype(dtype, copy=False)
        cross = np.einsum("rij,rj->ri", state.covariance, slope)
        variance = np.einsum("ri,ri->r", slope, cross) + noise
        gain = cross / variance[:, None]
        innovation = measurement - predicted
        mean = state.mean + gain * innovation[:, None]
        kept = np.eye(self.process.order, dtype=dtype) - gain[:, :, None] * slope[:, None, :]
        covariance = kept @ state.covariance @ kept.swapaxes(1, 2) + noise * gain[:, :, None] * gain[:, None, :]
        return Correction(Moments(mean, 0.5 * (covariance + covariance.swapaxes(1, 2))), innovation, variance)

    def single(self, graph: ProcessGraph) -> StepFunction:
        """One step of one run as one function."""
        return StepFunction(self.process, graph, extended)

    def _matrix(self, state: FilterState) -> FloatArray:
        return state.covariance[0]


@final
@dataclass(frozen=True, eq=False, repr=False)
class UnscentedFilter(Filter):
    """Unscented Kalman filter."""

    title: ClassVar[str] = "unscented Kalman filter"

    alpha: float = 1.0  # Scaling of the sigma points, with beta = 2 (a Gaussian) and kappa = 0

    def __post_init__(self) -> None:
        if not self.alpha > 0.0:
            raise FilterError(f"Sigma points need alpha > 0; instead received {self.alpha:g}.")

    @cached_property
    def scaling(self) -> tuple[float, float, float]:
        """Spread sqrt(n + lambda) of the points, weight W_i of all but the centre, and weight of s s^T.

        The points lie as far out as without eddy currents: with many they would leave the model's distances.
        """
        order = self.process.order
        others = order - self.process.eddies
        spread = self.alpha * sqrt(others)
        return spread, 0.5 / spread**2, 2.0 - self.alpha**2 * (others / order)

    def _predicted(self, state: FilterState, voltage: FloatArray) -> Moments:
        _, weight, shift_weight = self.scaling
        points = self._points(state)
        order, count, runs = points.shape
        inputs = np.empty((count, *voltage.shape), voltage.dtype)
        inputs[:] = voltage
        moved = self.process.transition(points.reshape(order, -1).T, inputs.reshape(count * runs, *voltage.shape[1:]))
        moved = np.ascontiguousarray(moved.T, dtype=points.dtype).reshape(points.shape)
        delta, shift = _deviations(moved, weight)
        covariance = np.einsum("iar,jar->ijr", delta, delta)
        covariance *= weight
        covariance += shift_weight * (shift[:, None] * shift)
        covariance += self.process.process_covariance.astype(moved.dtype, copy=False)[:, :, None]
        return Moments((moved[:, 0] + shift).T, covariance.transpose(2, 0, 1))

    def _corrected(self, state: FilterState, measurement: FloatArray, output: Output) -> Correction:
        _, weight, shift_weight = self.scaling
        points = self._points(state)
        values = output.measure(points.reshape(len(points), -1).T)
        values = values.astype(points.dtype, copy=False).reshape(points.shape[1:])
        delta, shift = _deviations(points, weight)
        delta_z, shift_z = _deviations(values, weight)
        variance = weight * np.einsum("kr,kr->r", delta_z, delta_z)
        variance += shift_weight * shift_z**2 + output.variance
        cross = weight * np.einsum("kr,ikr->ir", delta_z, delta)
        cross += shift_weight * shift_z * shift
        innovation = measurement - (values[0] + shift_z)
        mean = state.mean + (cross * (innovation / variance)).T
        covariance = state.covariance - (cross[:, None] * cross / variance).transpose(2, 0, 1)
        return Correction(Moments(mean, covariance), innovation, variance)

    def _points(self, state: FilterState) -> FloatArray:
        """The points mean, mean + spread L_k and mean - spread L_k, eq. (20)."""
        runs, order = state.mean.shape
        points = np.empty((order, 2 * order + 1, runs), dtype=state.mean.dtype)
        columns, centre = self.scaling[0] * state.factor.transpose(1, 2, 0), state.mean.T
        points[:, 0] = centre
        np.add(centre[:, None], columns, out=points[:, 1 : order + 1])
        np.subtract(centre[:, None], columns, out=points[:, order + 1 :])
        return points

    def single(self, graph: ProcessGraph) -> StepFunction:
        """One step of one run as one function."""
        return StepFunction(self.process, graph, partial(unscented, self.scaling))

    def _matrix(self, state: FilterState) -> FloatArray:
        return state.factor[0].T


def _deviations(values: FloatArray, weight: float) -> tuple[FloatArray, FloatArray]:
    """delta_i = Y_i - Y_0 of shape (..., 2n, runs), and their weighted sum s = mean - Y_0."""
    delta = values[..., 1:, :] - values[..., :1, :]
    return delta, weight * delta.sum(axis=-2)


FilterKind = Literal["ukf", "ekf"]

_KINDS: dict[str, type[Filter]] = {"ukf": UnscentedFilter, "ekf": ExtendedFilter}


def kalman_filter(
    model: ActuatorModel | str | Path,
    kind: FilterKind = "ukf",
    *,
    sensors: Sequence[str] | None = None,
    biases: Sequence[str] | None = None,
    hall_bias: bool = True,
    noise: FilterNoise | None = None,
    distance: float | None = None,
    first_deviation_m: float | None = None,
    commanded: bool = False,
) -> Filter:
    """A filter of a model, its noise derived from the model and its first covariance chosen.

    Parameters
    ----------
    kind : {'ukf', 'ekf'}
        Unscented or extended.
    sensors : sequence of str or None
        Names of the sensors that it reads, as ``("current", "laser")``, in the order of a measurement's entries; the
        Hall element where None, or all sensors where there is none.
    biases : sequence of str or None
        Sensors whose bias is estimated, each as a state after the others.
    hall_bias : bool
        Estimate the Hall element's offset where ``biases`` is None and it is read.
    noise : FilterNoise or None
        Derived by :func:`femfit.estimate.noise.default_noise` where None.
    distance : float or None
        Operating point in m; the model's first reference distance, or the middle of its range, where None.
    first_deviation_m : float or None
        Standard deviation of the first estimate's distance; 1 mm where None, or less where the way is short.
    commanded : bool
        Whether it is stepped with what the drivers are told, in V or A for a current amplifier, instead of the voltages
        across the circuits.

    Returns
    -------
    Filter
        ``start([distance_m, velocity_m_s, current_A])``, then ``step(state, voltage, readings)`` every sample; a
        reading that is missing is NaN.

    Raises
    ------
    MissingPartError
        If the model lacks circuit, motion, sensor or inductance.
    FilterError
        If the kind is unknown.

    Examples
    --------
    >>> import femfit as ff
    >>> ukf = ff.kalman_filter("model.json")
    >>> ukf.process.names
    ('distance_m', 'velocity_m_s', 'current_A', 'hall_bias_V')
    >>> state = ukf.start([0.022, 0.0, 0.4])
    >>> state = ukf.step(state, 1.1, 2.7)
    >>> state.mean.shape
    (1, 4)
    """
    if kind not in _KINDS:
        raise FilterError(f"The kind of a filter must be one of {', '.join(_KINDS)}; instead received {kind!r}.")
    model = model_of(model)
    process = levitation_process(
        model,
        hall_bias=hall_bias,
        noise=noise,
        distance=distance,
        sensors=sensors,
        biases=biases,
        commanded=commanded,
    )
    covariance = process.require_start_covariance().copy()
    if first_deviation_m is not None:
        covariance[0, 0] = first_deviation_m**2
    return _KINDS[kind](replace(process, start_covariance=covariance))
