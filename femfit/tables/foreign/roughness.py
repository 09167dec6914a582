"""Noise of a force curve F(d), told from its curvature.

The curve is divided by a smooth positive envelope S(d) and contrasted over neighbours: for every q + 2 consecutive
points the unit vector that annihilates polynomials of degree q in log d. On white noise of relative size s each
contrast has variance s^2 whatever q; on a smooth curve the contrasts shrink with q. Where the robust spread of the
last three orders agrees within a factor of 1.8, their median is the noise; where it still falls, it is curvature.

References
----------
T. Gasser, L. Sroka, C. Jennen-Steinmetz, Residual variance and residual pattern in nonlinear regression, Biometrika 73
(1986) 625-633 (contrasts on uneven grids). P. Hall, J. W. Kay, D. M. Titterington, Asymptotically optimal
difference-based estimation of variance in nonparametric regression, Biometrika 77 (1990) 521-528 (higher orders).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from femfit.core.arrays import FloatArray

_MAD_TO_SIGMA = 1 / 0.6745
_VARIANCE_WITHIN_THREE = 0.9733  # of a standard normal cut at three
_MEAN_LOG_NORMAL = -(np.euler_gamma + math.log(2)) / 2  # mean of log|z|, z standard normal
_LARGEST_ORDER = 5
_FEWEST_CONTRASTS = 4
_FLAT = 1.8  # ratio of the last three spreads; most noisy curves of 9 points stay below, coarse smooth ones exceed
MIN_DISTANCES = 9
"""Four orders of at least four contrasts: fewer points cannot tell noise from curvature."""


@dataclass(frozen=True)
class Roughness:
    """Noise of one curve.

    Parameters
    ----------
    relative : float
        Robust standard deviation over the envelope of |F|; an upper bound where ``resolved`` is False.
    resolved : bool
        False if the spread still changes with the order, so that it is curvature of a coarse grid.
    sigma_N : ndarray, shape (n,)
        Estimated standard deviation of the force at each distance.
    """

    relative: float
    resolved: bool
    sigma_N: FloatArray


def measure_roughness(distances: FloatArray, force: FloatArray) -> Roughness | None:
    """Measure the noise of a force curve over ascending distances (m); None below nine of them or without force."""
    if len(distances) < MIN_DISTANCES or not np.any(force):
        return None
    x = np.log(distances)
    envelope = _envelope(x, force)
    largest = min(_LARGEST_ORDER, len(distances) - _FEWEST_CONTRASTS - 1)
    families = [_contrasts(x, force / envelope, degree) for degree in range(1, largest + 1)]
    spreads = [_spread(family) for family in families]
    resolved = max(spreads[-3:]) <= _FLAT * min(spreads[-3:])
    taken = largest - 3 + int(np.argsort(spreads[-3:])[1]) if resolved else int(np.argmin(spreads))
    sigma = _local_sigma(x, families[taken], taken + 1, spreads[taken]) * envelope
    return Roughness(spreads[taken], resolved, sigma)


def contrast_field(distances: FloatArray, force: FloatArray, order: int) -> FloatArray:
    """Contrast every current's curve over one common envelope, so that equal errors in newtons stay equal.

    Parameters
    ----------
    force : array, shape (n, m)
        N at n ascending distances (m) and m currents, not zero everywhere.
    """
    x = np.log(distances)
    envelope = _envelope(x, np.median(np.abs(force), axis=1) + 1e-9 * np.abs(force).max())
    return np.stack([_contrasts(x, column / envelope, order) for column in force.T], axis=1)


def _contrasts(x: FloatArray, values: FloatArray, degree: int) -> FloatArray:
    """Divided differences of degree + 2 neighbours with weights of unit norm, shape (n - degree - 1,)."""
    windows = sliding_window_view(x, degree + 2)
    scaled = (windows - windows.mean(axis=1, keepdims=True)) / np.ptp(windows, axis=1)[:, None]
    differences = scaled[:, :, None] - scaled[:, None, :] + np.eye(degree + 2)
    weights = 1 / differences.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    contrasts: FloatArray = np.sum(weights * sliding_window_view(values, degree + 2), axis=1)
    return contrasts


def _spread(contrasts: FloatArray) -> float:
    """Standard deviation without outliers: root mean square of what lies within three robust deviations."""
    robust = float(np.median(np.abs(contrasts))) * _MAD_TO_SIGMA
    inside = contrasts[np.abs(contrasts) <= 3 * robust]
    return float(np.sqrt(np.mean(inside**2) / _VARIANCE_WITHIN_THREE))


def _envelope(x: FloatArray, force: FloatArray) -> FloatArray:
    """Smooth positive size of a curve: a robust polynomial of log|F| over log d, shape (n,)."""
    size = np.abs(force)
    target = np.log(np.maximum(size, 1e-6 * size.max()))
    basis = np.vander(2 * (x - x.mean()) / np.ptp(x), 4 if len(x) > 9 else 3)
    weights = np.ones(len(x))
    fitted = target
    for _ in range(10):
        solution, *_ = np.linalg.lstsq(basis * weights[:, None], target * weights, rcond=None)
        fitted = basis @ solution
        residual = target - fitted
        scale = np.median(np.abs(residual)) * _MAD_TO_SIGMA + 1e-9
        weights = 1 / np.sqrt(1 + (residual / (2 * scale)) ** 2)  # Cauchy weights: a sign change is no size
    envelope: FloatArray = np.exp(fitted)
    return envelope


def _local_sigma(x: FloatArray, contrasts: FloatArray, order: int, overall: float) -> FloatArray:
    """Relative noise as a power of d: a magnet's self-force error falls more slowly than its force, shape (n,)."""
    if len(contrasts) < 12 or overall == 0:
        return np.full(len(x), overall)
    centres = np.array([x[start : start + order + 2].mean() for start in range(len(contrasts))])
    size = np.log(np.maximum(np.abs(contrasts), 0.02 * overall)) - _MEAN_LOG_NORMAL
    slope, level = np.polyfit(centres - x.mean(), size, 1)
    sigma: FloatArray = np.clip(np.exp(level + slope * (x - x.mean())), overall / 10, 10 * overall)
    return sigma
