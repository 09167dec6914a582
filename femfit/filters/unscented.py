"""The unscented Kalman filter with control input, the paper's (19) to (31)."""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.filters.filter import Correction, Filter, Moments, moments_of
from femfit.filters.filter_state import FilterState
from femfit.filters.process import FilterProcess
from femfit.filters.sigma_points import SigmaScaling, deviations, sigma_points


@final
@dataclass(frozen=True, eq=False)
class UnscentedFilter(Filter):
    """Unscented Kalman filter in difference form.

    Parameters
    ----------
    process : FilterProcess
        The world as told to the filter.
    alpha, beta, kappa : float
        Scaling of the sigma points; the paper's alpha is 0.002.
    redraw : bool
        Draw new sigma points from the predicted moments for the update (they then contain Q), or reuse the propagated
        ones as the paper does.

    References
    ----------
    A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (19) to (31).
    S. J. Julier and J. K. Uhlmann, Proc. IEEE 92 (2004) 401.
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0
    redraw: bool = True

    @cached_property
    def scaling(self) -> SigmaScaling:
        """Spread and weights."""
        return SigmaScaling(self.process.order, self.alpha, self.beta, self.kappa)

    def _predicted(self, state: FilterState, voltage: FloatArray) -> Moments:
        moved = propagated(self.process, state, voltage, self.scaling.spread)
        delta, shift = deviations(moved, self.scaling.weight)
        dtype = moved.dtype.type
        covariance = dtype(self.scaling.weight) * np.matmul(delta.swapaxes(1, 2), delta)
        covariance += dtype(self.scaling.shift_weight) * (shift[:, :, None] * shift[:, None, :])
        covariance += self.process.process_covariance.astype(moved.dtype)
        return moments_of(moved[:, 0] + shift, covariance, None if self.redraw else moved)

    def _corrected(self, state: FilterState, measurement: FloatArray) -> Correction:
        predicted, variance, cross = output_moments(self.process, state, self.scaling)
        innovation = measurement - predicted
        gain = cross / variance[:, None]
        mean = state.mean + gain * innovation[:, None]
        covariance = state.covariance - gain[:, :, None] * cross[:, None, :]
        return Correction(moments_of(mean, covariance), innovation, variance)


def propagated(process: FilterProcess, state: FilterState, voltage: FloatArray, spread: float) -> FloatArray:
    """Sigma points of a state, moved by the transition, eq. (22).

    Parameters
    ----------
    voltage : array, shape (runs,)
        Input.

    Returns
    -------
    array, shape (runs, 2n + 1, n)
        In the state's precision.
    """
    points = sigma_points(state.mean, state.factor, spread)
    inputs = np.repeat(voltage, points.shape[1])
    moved = process.transition(points.reshape(-1, points.shape[2]), inputs)
    return moved.astype(points.dtype, copy=False).reshape(points.shape)


def output_moments(
    process: FilterProcess, state: FilterState, scaling: SigmaScaling
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What the filter expects of the measurement, eqs. (25) to (28).

    Parameters
    ----------
    state : FilterState
        After the prediction; its own sigma points are used where it kept them, new ones drawn otherwise.

    Returns
    -------
    mean, variance : array, shape (runs,)
        Of the measurement, R included.
    cross : array, shape (runs, n)
        Covariance of state and measurement.
    """
    points = state.points
    if points is None:
        points = sigma_points(state.mean, state.factor, scaling.spread)
    values = process.measure(points.reshape(-1, points.shape[2])).astype(points.dtype, copy=False)
    values = values.reshape(points.shape[:2])
    dtype = points.dtype.type
    weight, shift_weight = dtype(scaling.weight), dtype(scaling.shift_weight)
    delta, shift = deviations(points, scaling.weight)
    delta_z, shift_z = deviations(values, scaling.weight)
    variance = weight * np.einsum("rk,rk->r", delta_z, delta_z) + shift_weight * shift_z**2
    cross = weight * np.matmul(delta_z[:, None, :], delta)[:, 0] + shift_weight * shift_z[:, None] * shift
    return values[:, 0] + shift_z, variance + dtype(process.measurement_variance), cross
