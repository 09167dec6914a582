"""A guess of the noise where nothing tells it: what neighbouring settings leave beside a straight line.

A model's misfit is smooth over distance and current. Of three neighbours on a line the middle one, less the straight
line through the others, holds noise and little else: e = a y_before + b y_after - y has the variance
(a^2 + b^2 + 1) sigma^2. Noise that lasts from reading to reading hides from neighbours that were read one after the
other, and seldom from those along the other setting, so that the larger of both guesses counts.

References
----------
T. Gasser, L. Sroka and C. Jennen-Steinmetz, Biometrika 73 (1986) 625: pseudo-residuals.
P. J. Rousseeuw and C. Croux, J. American Statistical Association 88 (1993) 1273: median absolute deviation, 37 %.
"""

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.identify.constants import GUESS_WIDER, INDEPENDENT_DIFFERENCES, LEAST_NEIGHBOURS, NORMAL_MEDIAN, SAME_LINE
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.repeats import levels


def guessed_noise(observations: Observations, channel: str) -> tuple[float, float]:
    """A standard deviation of one reading, on the wide side, and its degrees of freedom; 0 where there is no guess."""
    here = observations.of(channel)
    residual = observations.residual[here]
    at = {name: observations.setting(name)[here] for name in observations.settings}
    beside = (observations.column("run")[here], observations.column("branch")[here])
    guesses = []
    for along, values in at.items():
        lines = np.stack([*beside, *(levels(at[fixed], SAME_LINE) for fixed in at if fixed != along)])
        differences = _pseudo_residuals(residual, values, lines)
        if len(differences) >= LEAST_NEIGHBOURS:
            sigma = float(np.median(np.abs(differences))) / NORMAL_MEDIAN
            guesses.append((GUESS_WIDER * sigma, INDEPENDENT_DIFFERENCES * len(differences)))
    return max(guesses, default=(0.0, 0.0))


def _pseudo_residuals(y: FloatArray, x: FloatArray, lines: FloatArray) -> FloatArray:
    """Middle readings less the line through their neighbours, each with the variance of one reading."""
    _, line = np.unique(lines, axis=1, return_inverse=True)
    frame = pd.DataFrame({"line": line.ravel(), "x": x, "y": y}).groupby(["line", "x"], as_index=False).first()
    number, at, value = (frame[name].to_numpy() for name in ("line", "x", "y"))
    inside = np.flatnonzero(number[:-2] == number[2:]) if len(number) > 2 else np.zeros(0, dtype=np.intp)
    before, middle, after = inside, inside + 1, inside + 2
    weight = (at[after] - at[middle]) / (at[after] - at[before])
    left = weight * value[before] + (1.0 - weight) * value[after] - value[middle]
    return np.asarray(left / np.sqrt(weight**2 + (1.0 - weight) ** 2 + 1.0))
