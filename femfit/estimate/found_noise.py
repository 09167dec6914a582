"""The noises that a record shows, in plain words, and a model that has them.

Noises from the autocovariances of the innovations, beside those of the likelihood: least squares, no search.

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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls

from femfit.core.numerics import FloatArray
from femfit.estimate.consistency import DryFriction
from femfit.estimate.constants import COVARIANCE_BLOCK, COVARIANCE_LAGS, LEAST_BLOCKS_OF_RECORD
from femfit.estimate.words import sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.sensors import HALL, reading_of
from femfit.model.validity import ProcessNoise


@dataclass(frozen=True)
class NoiseEstimate:
    """A standard deviation or density from a record."""

    name: str  # acceleration, voltage, or a sensor's
    unit: str
    value: float
    assumed: float  # What the filter was given
    low: float  # 95 % interval
    high: float
    known: bool  # False where the record only says that it is no larger than ``high``

    @property
    def tells(self) -> bool:
        """Whether the record says more than that the noise may be larger than the filter was given."""
        return self.known or self.high < self.assumed


@dataclass(frozen=True, eq=False)
class FoundNoise:
    """All noises of a record."""

    estimates: tuple[NoiseEstimate, ...]
    samples: int
    force_N: float | None  # Force error that the acceleration noise amounts to
    shares: dict[str, dict[str, float]]  # Of each sensor's innovations' variance, by what makes it
    # The same noises by least squares on the autocovariances of the innovations
    by_autocovariance: tuple[NoiseEstimate, ...] = ()
    friction: DryFriction | None = None  # That the model does not know, where the record shows one

    def lines(self, *, lost: bool = False) -> list[str]:
        """In plain words; a noise that may be larger than the filter was given is not told where it is not known.

        Parameters
        ----------
        lost : bool
            Whether the filter was lost: then what the innovations are made of cannot be told.
        """
        return sentence("observe", "noise", self, lost).splitlines()

    @property
    def disagrees(self) -> bool:
        """Whether an interval of one method lies wholly outside of the other's."""
        pairs = [
            (first, second)
            for first in self.estimates
            for second in self.by_autocovariance
            if first.name == second.name
        ]
        return any(first.low > second.high or (first.known and second.low > first.high) for first, second in pairs)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return {
            "estimates": [vars(estimate) for estimate in self.estimates],
            "by_autocovariance": [vars(estimate) for estimate in self.by_autocovariance],
            "friction": self.friction and vars(self.friction),
            "samples": self.samples,
            "shares": self.shares,
        }


def with_noise(model: ActuatorModel, noise: FoundNoise) -> ActuatorModel:
    """The model with the noises that a record showed; what the record could not tell stays."""
    deviations = {estimate.name: estimate.value for estimate in noise.estimates if estimate.known}
    process = ProcessNoise(
        deviations["acceleration"] ** 2 if "acceleration" in deviations else None, deviations.get("voltage")
    )

    def changed(quiet: ActuatorModel) -> ActuatorModel:
        def own(name: str, before: float) -> float:  # what is left of the noise beside the converter's rounding
            rounding = reading_of(quiet, name).white ** 2 - before**2
            return float(np.sqrt(max(deviations[name] ** 2 - rounding, 0.0))) if name in deviations else before

        sensors = tuple(replace(s, noise=own(s.name, s.noise)) for s in quiet.other_sensors)
        hall = quiet.sensor and replace(quiet.sensor, noise_V=own(HALL, quiet.sensor.noise_V))
        return replace(quiet, other_sensors=sensors, sensor=hall, process_noise=process)

    held = changed(model)
    return held if model.base is None else replace(held, base=changed(model.base))


class Stretches(NamedTuple):
    """Pieces of a record side by side, as a filter saw them: (steps, pieces, ...)."""

    innovation: FloatArray  # Reading less prediction; (steps, pieces, sensors)
    slope: FloatArray  # F from each sample to the next; (steps, pieces, n, n)
    outputs: FloatArray  # H; (steps, pieces, sensors, n)
    shift: FloatArray  # K e; (steps, pieces, n)
    forgotten: int  # Steps at the begin of a piece that do not count


class Source(NamedTuple):
    """A noise as the filter was given it."""

    name: str  # acceleration, voltage, or a sensor's
    unit: str
    assumed: float  # Standard deviation or density
    motion: FloatArray  # Its part of Q; (n, n)
    readings: FloatArray  # And of the sensors' variances; (sensors,)

    def estimate(self, value: float, low: float, high: float, known: bool) -> NoiseEstimate:
        """What a record shows of it."""
        return NoiseEstimate(
            self.name, self.unit, float(value), float(self.assumed), float(low), float(high), bool(known)
        )


class Factors(NamedTuple):
    """Variances over those that the filter was given, and their standard deviations."""

    value: FloatArray  # (noises,)
    deviation: FloatArray


def variance_factors(stretches: Stretches, sources: Sequence[Source], fixed: FloatArray) -> Factors | None:
    """Fit the sizes of noises to autocovariances; None where too few products of readings are known.

    Parameters
    ----------
    fixed : array, shape (n, n)
        Q of what is not searched for.
    """
    readings = np.sum([source.readings for source in sources], axis=0)
    gains = _gains(stretches, fixed + np.sum([source.motion for source in sources], axis=0), readings)
    noises = [(source.motion, source.readings) for source in sources]
    parts = _predicted(stretches, gains, [*noises, (fixed, np.zeros(len(readings)))])
    products = _products(stretches.innovation)
    steps = np.arange(len(products))
    use = steps >= stretches.forgotten
    count = max(1, int(use.sum()) // COVARIANCE_BLOCK)
    blocks = np.array_split(steps[use], count)
    # (blocks * pieces, entries), and the same with noises + 1; the mean over the products that both readings give
    measured = np.concatenate([_mean(products[rows], products[rows]) for rows in blocks])
    design = np.concatenate([_mean(parts[rows], products[rows][..., None]) for rows in blocks])
    seen_in = np.isfinite(measured).sum(axis=0)
    entries = seen_in >= LEAST_BLOCKS_OF_RECORD
    measured, design, seen_in = measured[:, entries], design[:, entries], seen_in[entries]
    if len(seen_in) < len(noises) or not np.nanmax(np.abs(design[:, :, :-1]), axis=(0, 1)).all():
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
