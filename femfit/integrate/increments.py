"""Field increments by the trapezoidal rule, from block to block: P. Arpaia et al., Sensors 22 (2022) 182, (7)."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.integrate.constants import GAP
from femfit.integrate.uncertainty import Noise, SensingCoil
from femfit.tables.coil_block import CoilBlock


@dataclass(frozen=True)
class LastSample:
    """Time and voltage of the last sample, NaN before the first; the largest |voltage| so far bounds a gap's secret."""

    time: float = float("nan")
    voltage: float = float("nan")
    highest: float = 0.0


@dataclass(frozen=True, eq=False)
class Increments:
    """B_k - B_(k-1) of a block's samples."""

    dt: FloatArray  # Since the sample before, s; 0 at a record's first sample; shape (n,)
    field: FloatArray  # Increment in T; shape (n,)
    variance: FloatArray  # Noise variance of the increment, T^2, with what a gap may hide; shape (n,)


def increments(
    last: LastSample, block: CoilBlock, coil: SensingCoil, noise: Noise, sample_time: float
) -> tuple[LastSample, Increments]:
    """Trapezoids of a block, with the trapezoid that joins it to the block before.

    Two trapezoids share a sample's noise, so that the increments of n samples have the variance of n samples; the
    paper's (11) takes them as independent and arrives at half of it.
    """
    first = np.isnan(last.time)
    time = np.concatenate([[block.time[0] if first else last.time], block.time])
    voltage = np.concatenate([[block.voltage[0] if first else last.voltage], block.voltage])
    dt = np.diff(time)
    sample = noise.voltage.variance(voltage)
    variance = np.square(dt / coil.area_m2) * (sample[1:] + sample[:-1]) / 2.0
    gap = dt > GAP * sample_time
    if np.any(gap):
        before = np.maximum.accumulate(np.maximum(np.abs(voltage), last.highest))[:-1]
        variance += np.where(gap, np.square(dt * before / coil.area_m2), 0.0)
    field = dt * (voltage[1:] + voltage[:-1]) / (2.0 * coil.area_m2)
    highest = max(last.highest, float(np.abs(block.voltage).max()))
    return LastSample(float(time[-1]), float(voltage[-1]), highest), Increments(dt, field, variance)
