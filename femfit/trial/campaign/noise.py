"""What the meters add to the true readings: correlated noise, 12-bit converters, lost readings and rows."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray, IntArray

_BITS = 12


@dataclass(frozen=True)
class Meter:
    """One channel's meter.

    Parameters
    ----------
    full_scale : float
        Largest magnitude that the converter reads; its step is a 4096th of twice that.
    """

    sigma: float
    rho: float
    full_scale: float

    @property
    def step(self) -> float:
        """Of the converter."""
        return 2.0 * self.full_scale / 2.0**_BITS


def drawn_meters(truth: Mapping[str, FloatArray], generator: np.random.Generator) -> dict[str, Meter]:
    """Draw a meter for every channel: noise of 0.1 to 0.6 % of the channel's span."""
    result = {}
    for name, values in truth.items():
        share = float(np.exp(generator.uniform(np.log(1e-3), np.log(6e-3))))
        result[name] = Meter(
            sigma=share * float(np.ptp(values)),
            rho=float(generator.uniform(0.0, 0.6)),
            full_scale=1.3 * float(np.abs(values).max()),
        )
    return result


def measured(values: FloatArray, meter: Meter, run: IntArray, generator: np.random.Generator) -> FloatArray:
    """Readings of a meter.

    Parameters
    ----------
    values : array, shape (n,)
        True, in the order of measuring.
    run : array of int, shape (n,)
        Each run's noise starts anew.

    Returns
    -------
    array, shape (n,)
        With first-order autoregressive noise, rounded to the converter's steps.
    """
    fresh = generator.standard_normal(len(values))
    noise = fresh.copy()
    for k in range(1, len(values)):
        if run[k] == run[k - 1]:
            noise[k] = meter.rho * noise[k - 1] + np.sqrt(1.0 - meter.rho**2) * fresh[k]
    return np.asarray(np.round((values + meter.sigma * noise) / meter.step) * meter.step)
