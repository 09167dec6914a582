"""Scaled sigma points and their moments in difference form, shared by both unscented filters.

With delta_i = Y_i - Y_0 and s = sum_i W_i delta_i, the weighted mean is Y_0 + s, and the weighted covariance about it
is sum_{i>0} W_i delta_i delta_i^T + (beta - alpha^2) s s^T: the centre weight, -2.5e5 for alpha = 0.002, has cancelled
algebraically, so that it cannot cancel numerically, and for beta >= alpha^2 every term is positive semidefinite.

Points are arrays of shape (n, 2n + 1, runs), the centre first: what is computed for all runs at once lies together in
memory.

References
----------
S. J. Julier, The scaled unscented transformation, American Control Conference (2002) 4555.
S. J. Julier and J. K. Uhlmann, Proc. IEEE 92 (2004) 401.
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (19) to (31).
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import FilterError
from femfit.filters.filter import Filter
from femfit.filters.filter_state import FilterState


@dataclass(frozen=True, eq=False)
class SigmaPointFilter(Filter):
    """An unscented filter.

    Parameters
    ----------
    alpha, beta, kappa : float
        Scaling of the sigma points; beta is 2 for a Gaussian.
    redraw : bool
        Draw new sigma points from the predicted moments for the update (they then contain Q), or reuse the propagated
        ones.
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0
    redraw: bool = True

    def __post_init__(self) -> None:
        order = self.process.order
        if not (self.alpha > 0.0 and order + self.kappa > 0.0):
            raise FilterError(
                f"Sigma points need alpha > 0 and kappa > -{order}; instead received alpha = {self.alpha:g} and "
                f"kappa = {self.kappa:g}."
            )

    @property
    def spread(self) -> float:
        """sqrt(n + lambda) with lambda = alpha^2 (n + kappa) - n."""
        return self.alpha * float(np.sqrt(self.process.order + self.kappa))

    @property
    def weight(self) -> float:
        """W_i of every point but the centre, eq. (21)."""
        return 0.5 / self.spread**2

    @property
    def shift_weight(self) -> float:
        """Weight beta - alpha^2 of s s^T."""
        return self.beta - self.alpha**2

    def propagated(self, state: FilterState, voltage: FloatArray) -> FloatArray:
        """Sigma points of a state, moved by the transition, eq. (22)."""
        points = sigma_points(state.mean, state.factor, self.spread)
        order, count, runs = points.shape
        inputs = np.empty((count, runs), voltage.dtype)
        inputs[:] = voltage
        moved = self.process.transition(points.reshape(order, -1).T, inputs.ravel())
        return np.ascontiguousarray(moved.T, dtype=points.dtype).reshape(points.shape)

    def output_moments(self, state: FilterState) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Mean, variance (R included) and covariance with the state of the expected measurement, eqs. (25) to (28).

        Parameters
        ----------
        state : FilterState
            After the prediction; its own sigma points are used where it kept them, new ones drawn otherwise.

        Returns
        -------
        cross : array, shape (n, runs)
            Covariance of state and measurement.
        """
        points = state.points
        if points is None:
            points = sigma_points(state.mean, state.factor, self.spread)
        values = self.process.measure(points.reshape(len(points), -1).T)
        values = values.astype(points.dtype, copy=False).reshape(points.shape[1:])
        dtype = points.dtype.type
        delta, shift = deviations(points, self.weight)
        delta_z, shift_z = deviations(values, self.weight)
        variance = np.einsum("kr,kr->r", delta_z, delta_z)
        variance *= dtype(self.weight)
        variance += dtype(self.shift_weight) * shift_z**2 + dtype(self.process.measurement_variance)
        cross = np.einsum("kr,ikr->ir", delta_z, delta)
        cross *= dtype(self.weight)
        cross += dtype(self.shift_weight) * shift_z * shift
        return values[0] + shift_z, variance, cross


def sigma_points(mean: FloatArray, factor: FloatArray, spread: float) -> FloatArray:
    """The points mean, mean + spread L_k and mean - spread L_k, eq. (20).

    Parameters
    ----------
    mean : array, shape (runs, n)
        Means.
    factor : array, shape (runs, n, n)
        Lower Cholesky factors L.
    """
    runs, order = mean.shape
    points = np.empty((order, 2 * order + 1, runs), dtype=mean.dtype)
    columns, centre = mean.dtype.type(spread) * factor.transpose(1, 2, 0), mean.T
    points[:, 0] = centre
    np.add(centre[:, None], columns, out=points[:, 1 : order + 1])
    np.subtract(centre[:, None], columns, out=points[:, order + 1 :])
    return points


def deviations(values: FloatArray, weight: float) -> tuple[FloatArray, FloatArray]:
    """delta_i = Y_i - Y_0 and their weighted sum s.

    Returns
    -------
    delta : array, shape (..., 2n, runs)
        Differences from the centre.
    shift : array, shape (..., runs)
        s = mean - Y_0.
    """
    delta = values[..., 1:, :] - values[..., :1, :]
    return delta, values.dtype.type(weight) * delta.sum(axis=-2)
