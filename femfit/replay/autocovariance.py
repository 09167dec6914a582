"""Noises from the autocovariances of the innovations, beside those of the likelihood: least squares, no search.

A filter with gains K of its own has the prediction's error eps+ = A eps - F K n + w with A = F (1 - K H), and
innovations e = H eps + n. Their autocovariances

    E[e e']          = H S H' + R
    E[e(k+j) e(k)']  = H A^(j-1) (A S H' - F K R),      S+ = A S A' + Q + F K R K' F'

are linear in Q and R, so that each noise's part is computed alone and their sizes follow from least squares with no
size below zero. Along a record A, H and K change; the means over its samples are compared. The scatter of blocks gives
weights and intervals.

References
----------
B. J. Odelson, M. R. Rajamani and J. B. Rawlings, Automatica 42 (2006) 303.
M. R. Rajamani and J. B. Rawlings, Automatica 45 (2009) 142 (weights).
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from femfit.core.arrays import FloatArray
from femfit.replay.constants import COVARIANCE_BLOCK, COVARIANCE_LAGS, LEAST_BLOCKS


class Stretches(NamedTuple):
    """Pieces of a record side by side, as a filter saw them: (steps, pieces, ...)."""

    innovation: FloatArray  # Reading less prediction; (steps, pieces, sensors)
    slope: FloatArray  # F from each sample to the next; (steps, pieces, n, n)
    outputs: FloatArray  # H; (steps, pieces, sensors, n)
    shift: FloatArray  # K e; (steps, pieces, n)
    forgotten: int  # Steps at the begin of a piece that do not count


class Factors(NamedTuple):
    """Variances over those that the filter was given, and their standard deviations."""

    value: FloatArray  # (noises,)
    deviation: FloatArray


def variance_factors(
    stretches: Stretches, causes: list[FloatArray], fixed: FloatArray, readings: FloatArray
) -> Factors | None:
    """Fit the sizes of noises to autocovariances; None where too few products of readings are known.

    Parameters
    ----------
    causes : list of array, shape (n, n)
        Q of each process noise that is searched for, as the filter was given it.
    fixed : array, shape (n, n)
        Q of what is not searched for.
    readings : array, shape (sensors,)
        Variances of the sensors as the filter was given them.
    """
    sensors, order = len(readings), len(fixed)
    none, zero = np.zeros(sensors), np.zeros((order, order))
    noises = [(q, none) for q in causes]
    noises += [(zero, np.where(np.arange(sensors) == s, readings, 0.0)) for s in range(sensors)]
    gains = _gains(stretches, sum(causes, fixed), readings)
    parts = _predicted(stretches, gains, [*noises, (fixed, none)])
    products = _products(stretches.innovation)
    steps = np.arange(len(products))
    use = steps >= stretches.forgotten
    count = max(1, int(use.sum()) // COVARIANCE_BLOCK)
    blocks = np.array_split(steps[use], count)
    # (blocks * pieces, entries), and the same with noises + 1; the mean over the products that both readings give
    measured = np.concatenate([_mean(products[rows], products[rows]) for rows in blocks])
    design = np.concatenate([_mean(parts[rows], products[rows][..., None]) for rows in blocks])
    seen_in = np.isfinite(measured).sum(axis=0)
    entries = seen_in >= LEAST_BLOCKS
    measured, design, seen_in = measured[:, entries], design[:, entries], seen_in[entries]
    if len(seen_in) < len(noises) or not _every_noise_shows(design[:, :, :-1]):
        return None
    target = measured - design[:, :, -1]
    matrix = np.nanmean(design[:, :, :-1], axis=0)
    scale = np.maximum(np.nanstd(target, axis=0, ddof=1), np.finfo(float).tiny)
    value, _ = nnls(matrix / scale[:, None], np.nanmean(target, axis=0) / scale)
    residual = target - design[:, :, :-1] @ value
    scale = np.maximum(np.nanstd(residual, axis=0, ddof=1), np.finfo(float).tiny)
    value, _ = nnls(matrix / scale[:, None], np.nanmean(target, axis=0) / scale)
    weighted = matrix / scale[:, None]
    share = np.nan_to_num((target - design[:, :, :-1] @ value) / scale) * (len(measured) / seen_in)
    influence = share @ weighted @ np.linalg.pinv(weighted.T @ weighted)
    return Factors(value, influence.std(axis=0, ddof=1) / np.sqrt(len(influence)))


def _mean(values: FloatArray, products: FloatArray) -> FloatArray:
    """Mean over the steps at which a product is known; NaN where it never is."""
    finite = np.isfinite(products)
    count = finite.sum(axis=0)
    total = np.where(finite, values, 0.0).sum(axis=0)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def _every_noise_shows(design: FloatArray) -> bool:
    """Whether each noise is in one of the products that are left."""
    return bool((np.nanmax(np.abs(design), axis=(0, 1)) > 0.0).all())


def _gains(stretches: Stretches, q: FloatArray, readings: FloatArray) -> FloatArray:
    """Gains K of the filter with the noises that it was given; (steps, pieces, n, sensors)."""
    steps, pieces, sensors, order = stretches.outputs.shape
    covariance = np.broadcast_to(q * steps, (pieces, order, order))
    result = np.empty((steps, pieces, order, sensors))
    for k in range(steps):
        h, f = stretches.outputs[k] * np.isfinite(stretches.innovation[k])[:, :, None], stretches.slope[k]
        cross = covariance @ h.swapaxes(1, 2)
        total = h @ cross + np.diag(readings)
        gain = np.linalg.solve(total, cross.swapaxes(1, 2)).swapaxes(1, 2)
        result[k] = gain
        covariance = covariance - gain @ cross.swapaxes(1, 2)
        covariance = f @ covariance @ f.swapaxes(1, 2) + q
        covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))
    return result


def _predicted(stretches: Stretches, gains: FloatArray, noises: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """What each noise alone makes of every product e(k+j) e(k)'; (steps, pieces, entries, noises)."""
    steps, pieces, sensors, order = stretches.outputs.shape
    f, h = stretches.slope, stretches.outputs
    closed = f @ (np.eye(order) - gains @ h)
    driven = f @ gains
    products = []
    for q, r in noises:
        noise = np.diag(r)
        spread, first = np.broadcast_to(q * 1.0, (pieces, order, order)), np.empty((steps, pieces, sensors, sensors))
        carried = np.empty((steps, pieces, order, sensors))
        for k in range(steps):
            cross = spread @ h[k].swapaxes(1, 2)
            first[k] = h[k] @ cross + noise
            carried[k] = closed[k] @ cross - driven[k] @ noise
            spread = closed[k] @ spread @ closed[k].swapaxes(1, 2) + q
            spread = spread + driven[k] @ noise @ driven[k].swapaxes(1, 2)
        lags = [first[: steps - COVARIANCE_LAGS]]
        for j in range(1, COVARIANCE_LAGS + 1):
            size = steps - COVARIANCE_LAGS
            lags.append(h[j : j + size] @ carried[:size])
            carried[:size] = closed[j : j + size] @ carried[:size]
        products.append(np.stack(lags, axis=2).reshape(steps - COVARIANCE_LAGS, pieces, -1))
    return np.stack(products, axis=-1)


def _products(innovation: FloatArray) -> FloatArray:
    """e(k+j) e(k)' of lags 0 to J; (steps - J, pieces, entries)."""
    size = len(innovation) - COVARIANCE_LAGS
    lags = [innovation[j : j + size, :, :, None] * innovation[:size, :, None, :] for j in range(COVARIANCE_LAGS + 1)]
    return np.stack(lags, axis=2).reshape(size, innovation.shape[1], -1)
