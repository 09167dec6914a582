"""Field increments by the trapezoidal rule, (7), carried from block to block."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.integrate.constants import GAP
from femfit.integrate.uncertainty import Noise, SensingCoil, increment_variance
from femfit.tables.coil_block import CoilBlock


@dataclass(frozen=True)
class LastSample:
    """What an integrator keeps of the past.

    Parameters
    ----------
    time, voltage : float
        Of the last sample; NaN before the first.
    highest : float
        Largest |voltage| so far: bounds what a gap may hide.
    """

    time: float = float("nan")
    voltage: float = float("nan")
    highest: float = 0.0


@dataclass(frozen=True, eq=False)
class Increments:
    """B_k - B_(k-1) of a block's samples.

    Parameters
    ----------
    dt : array, shape (n,)
        Since the sample before, s; 0 at a record's first sample.
    field : array, shape (n,)
        Increment in T.
    variance : array, shape (n,)
        Of its noise in T^2, and across a gap of what the gap may hide.
    gap : array of bool, shape (n,)
        Whether samples are missing before this one.
    """

    dt: FloatArray
    field: FloatArray
    variance: FloatArray
    gap: BoolArray


def increments(
    last: LastSample, block: CoilBlock, coil: SensingCoil, noise: Noise, sample_time: float
) -> tuple[LastSample, Increments]:
    """Trapezoids of a block, with the trapezoid that joins it to the block before."""
    first = np.isnan(last.time)
    time = np.concatenate([[block.time[0] if first else last.time], block.time])
    voltage = np.concatenate([[block.voltage[0] if first else last.voltage], block.voltage])
    dt = np.diff(time)
    variance = increment_variance(noise, coil, voltage, dt)
    gap = dt > GAP * sample_time
    highest = float(np.abs(block.voltage).max())
    if np.any(gap):
        before = np.maximum.accumulate(np.maximum(np.abs(voltage), last.highest))[:-1]
        variance += np.where(gap, np.square(dt * before / coil.area_m2), 0.0)
    field = dt * (voltage[1:] + voltage[:-1]) / (2.0 * coil.area_m2)
    end = LastSample(float(time[-1]), float(voltage[-1]), max(last.highest, highest))
    return end, Increments(dt, field, variance, gap)
