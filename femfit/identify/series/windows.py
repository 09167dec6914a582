"""Which stretches of a record are looked at together, and what is known of the motion there.

A window is long enough for its noise to be small beside what effects do, and short enough to see the motion: one and a
half time constants of the falling body, as long as that leaves enough windows and enough samples in each.
"""

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.identify.series.weights import LEAST_SAMPLES, Windows
from femfit.model.actuator_model import ActuatorModel

_TIME_CONSTANTS = 1.5
_LEAST_WINDOWS, _MOST_WINDOWS = 120, 1200
_SAMPLES = 3 * LEAST_SAMPLES
"""In a window: enough for its middle third."""


def lay_windows(
    model: ActuatorModel,
    time: FloatArray,
    segment: IntArray,
    usable: BoolArray,
    distance: FloatArray,
    current: FloatArray,
) -> Windows:
    """Windows of equal length over every segment of a record.

    Parameters
    ----------
    time, segment : array, shape (N,)
        Of the samples.
    usable : array of bool, shape (N,)
        Samples at which the model can be evaluated.
    distance, current : array, shape (N,)
        In m and A.

    Returns
    -------
    Windows
        None of them where no segment is long enough.
    """
    numbers = np.unique(segment)
    starts, ends = (np.array([time[segment == k][pick] for k in numbers]) for pick in (0, -1))
    total = float(np.sum(ends - starts))
    spacing = np.diff(time)[np.diff(segment) == 0]
    usual = float(np.median(spacing)) if len(spacing) else 0.0
    wanted = min(_TIME_CONSTANTS / _pole(model, distance[usable], current[usable]), total / _LEAST_WINDOWS)
    length = max(wanted, _SAMPLES * usual, total / _MOST_WINDOWS)
    counts = np.floor((ends - starts) / length * (1.0 + 1e-9)).astype(int) if length > 0.0 else np.zeros(0, dtype=int)
    centre = [start + length * (0.5 + np.arange(n)) for start, n in zip(starts, counts, strict=True)]
    return Windows(np.concatenate(centre), np.repeat(numbers, counts), length)


def _pole(model: ActuatorModel, distance: FloatArray, current: FloatArray) -> float:
    """Rate at which the body runs away from (or swings about) where it is, in 1/s; 100 where nothing moves."""
    if model.motion is None or not len(distance):
        return 100.0
    pick = slice(None, None, max(1, len(distance) // 500))
    stiffness = model.magnetics.coenergy_derivatives(distance[pick], current[pick], ((2, 0),))[0]
    return float(np.sqrt(np.median(np.abs(stiffness)) / model.motion.mass_kg)) or 100.0
