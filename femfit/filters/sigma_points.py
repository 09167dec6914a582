"""Scaled sigma points and their moments in difference form.

With delta_i = Y_i - Y_0 and s = sum_i W_i delta_i, the weighted mean is Y_0 + s, and the weighted covariance about it
is sum_{i>0} W_i delta_i delta_i^T + (beta - alpha^2) s s^T: the centre weight, -2.5e5 for alpha = 0.002, has cancelled
algebraically, so that it cannot cancel numerically, and for beta >= alpha^2 every term is positive semidefinite.

References
----------
S. J. Julier, The scaled unscented transformation, American Control Conference (2002) 4555.
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (20) to (28).
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import FilterError


@dataclass(frozen=True)
class SigmaScaling:
    """The scaled transformation's three numbers.

    Parameters
    ----------
    beta : float
        Prior knowledge of the distribution; 2 for a Gaussian.
    """

    order: int
    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    def __post_init__(self) -> None:
        if not (self.alpha > 0.0 and self.order + self.kappa > 0.0):
            raise FilterError(
                f"Sigma points need alpha > 0 and kappa > -{self.order}; instead received alpha = {self.alpha:g} and "
                f"kappa = {self.kappa:g}."
            )

    @property
    def spread(self) -> float:
        """sqrt(n + lambda) with lambda = alpha^2 (n + kappa) - n."""
        return self.alpha * float(np.sqrt(self.order + self.kappa))

    @property
    def weight(self) -> float:
        """W_i of every point but the centre, eq. (21)."""
        return 0.5 / self.spread**2

    @property
    def shift_weight(self) -> float:
        """Weight beta - alpha^2 of s s^T."""
        return self.beta - self.alpha**2


def sigma_points(mean: FloatArray, factor: FloatArray, spread: float) -> FloatArray:
    """The points mean, mean + spread L_k and mean - spread L_k, eq. (20).

    Parameters
    ----------
    mean : array, shape (runs, n)
        Means.
    factor : array, shape (runs, n, n)
        Lower Cholesky factors L.

    Returns
    -------
    array, shape (runs, 2n + 1, n)
        The centre first.
    """
    runs, order = mean.shape
    points = np.empty((runs, 2 * order + 1, order), dtype=mean.dtype)
    columns = mean.dtype.type(spread) * factor.swapaxes(1, 2)
    points[:, 0] = mean
    np.add(mean[:, None], columns, out=points[:, 1 : order + 1])
    np.subtract(mean[:, None], columns, out=points[:, order + 1 :])
    return points


def deviations(values: FloatArray, weight: float) -> tuple[FloatArray, FloatArray]:
    """delta_i = Y_i - Y_0 and their weighted sum s.

    Parameters
    ----------
    values : array, shape (runs, 2n + 1, ...)
        Y, one row a sigma point, the centre first.

    Returns
    -------
    delta : array, shape (runs, 2n, ...)
        Differences from the centre.
    shift : array, shape (runs, ...)
        s = mean - Y_0.
    """
    delta = values[:, 1:] - values[:, :1]
    return delta, values.dtype.type(weight) * delta.sum(axis=1)
