"""How large a hidden effect has to be to stand out of the noise by a given amount."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.trial.virtual_bench import Meter
from support.trial_study.truth.bench import Hidden, Points, true_readings
from support.trial_study.truth.families import Truth

_EVEN = 0.9


def effect_over_noise(
    truth: Truth, points: Points, hidden: Hidden, size: float, meters: Mapping[str, Meter]
) -> dict[str, float]:
    """Root mean square of an effect over the noise, per channel."""
    without, with_it = true_readings(truth, points), true_readings(truth, points, [(hidden, size)])
    return {name: _rms(with_it[name] - without[name]) / meter.sigma for name, meter in meters.items()}


def even_channels(truth: Truth, points: Points, hidden: Hidden, size: float) -> list[str]:
    """Channels in which an effect is mostly the same at every setting: a winding sees a current offset so.

    Returns
    -------
    list of str
        Where nine tenths of the mean square are the mean's; of a ramp from zero it is three quarters.
    """
    without, with_it = true_readings(truth, points), true_readings(truth, points, [(hidden, size)])
    change = {name: with_it[name] - without[name] for name in without}
    return [name for name, by in change.items() if np.any(by) and np.mean(by) ** 2 > _EVEN * np.mean(by**2)]


def size_for(truth: Truth, points: Points, hidden: Hidden, target: float, meters: Mapping[str, Meter]) -> float:
    """The size at which the most affected channel shows an effect by ``target`` noise sigmas rms.

    Returns
    -------
    float
        NaN where the effect cannot be seen or would have to pass its limit.
    """

    def seen(size: float) -> float:
        return max(effect_over_noise(truth, points, hidden, size, meters).values())

    if not seen(hidden.limit) >= target:
        return float("nan")
    low, high = np.log(1e-9 * hidden.limit), np.log(hidden.limit)
    size = hidden.typical
    for _ in range(80):
        value = seen(size)
        if abs(value - target) < 1e-3 * target:
            break
        low, high = (np.log(size), high) if value < target else (low, np.log(size))
        # Most effects grow linearly or with the square: half of that step, in logarithms, is safe for both
        guess = np.log(size) + 0.7 * np.log(target / max(value, 1e-300))
        size = float(np.exp(guess if low < guess < high else 0.5 * (low + high)))
    return size


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
