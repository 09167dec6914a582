"""Integration of the voltage minus an offset that was seen while the field stood still: FFA1, FFA2.

The offset v_o is the mean over a zero reading at the record's begin (FFA1), or over the last second in which the field
stood still (FFA2). P. Arpaia et al., Sensors 22 (2022) 182, section 3.

An offset that is the mean of m samples with white noise s each is off by s / sqrt(m). Where W is the time for which
these samples are integrated themselves, their sum in the field is W / A times the same mean, so that field and offset
have the covariance (s^2 / m) W / A: after the time T in which the offset is in use the two together have the variance
(s^2 / m) (W - T)^2 / A^2. FFA2 integrates its windows, W = m T_s. FFA1 leaves the zero reading out but for half of its
last sample, which stands in the first trapezoid: W = T_s / 2.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.integrate.integrator import Integrator, IntegratorState, increments
from femfit.tables.coil_record import CoilBlock

SETTLING_S = 1.0
"""After each ramp, before ffa2 takes the mean voltage for the offset. Chosen: eddy currents of a small actuator decay
in milliseconds; a magnet with a solid yoke needs tens of seconds."""

STILL_A, STILL_V = 0.1, 1e-4
"""A current, or where there is none a mean voltage, that moves by less in a second is on a plateau. Chosen."""

WINDOW = 1.0
"""Seconds over which a voltage is averaged for the offset."""

BIN = 1e-3
"""Seconds over which a current is averaged before it tells a plateau: white noise of single samples grows with their
rate, and at 204.8 kS/s it would hide every plateau."""


class ZeroReading(NamedTuple):
    """When it began in s, the sum of its voltages in V, and of how many samples."""

    begin: float
    total: float = 0.0
    samples: int = 0


@dataclass(frozen=True)
class ZeroReadingIntegrator(Integrator):
    """FFA1: the field is held during the zero reading, whose mean up to each sample is the offset."""

    zero_reading: float = 0.0  # Seconds

    def begun(self, state: IntegratorState, block: CoilBlock, out: FloatArray) -> tuple[IntegratorState, int]:
        """Take the samples of the zero reading."""
        before = state.memory or ZeroReading(float(block.time[0]))
        count = int(np.sum(block.time - before.begin < self.zero_reading - 1e-3 * self.sample_time))
        if not count:
            return state, 0
        last, _ = increments(state.last, block[:count], self.coil, self.noise, self.sample_time)
        totals, samples = before.total + np.cumsum(block.voltage[:count]), before.samples + count
        state = self.with_offset(state, float(totals[-1]) / samples, samples, 0.5 * self.sample_time)
        self.write(out[:, :count], state.mean[0, :, None], 0.0, totals / np.arange(before.samples + 1, samples + 1))
        return replace(state, last=last, memory=ZeroReading(before.begin, float(totals[-1]), samples)), count


class Plateau(NamedTuple):
    """Seconds since the last ramp, or since the record's begin, and the last window's current in A."""

    still: float = math.inf  # no ramp yet: the first still window counts
    level: float = math.nan


@dataclass(frozen=True)
class PlateauIntegrator(Integrator):
    """FFA2: the offset is the mean of the last window on a plateau, which the current tells, or else the voltage."""

    interval: float = WINDOW
    settling: float = SETTLING_S  # Seconds after a ramp
    still_A: float = STILL_A

    def corrected(self, state: IntegratorState, samples: FloatArray, _out: FloatArray) -> IntegratorState:
        """Take the mean of a complete window that is settled; it holds from the next sample on."""
        before = state.memory or Plateau()
        _, voltage, _, current, *_ = samples
        size = min(max(1, round(BIN / self.sample_time)), len(voltage))
        means = current[: len(current) // size * size].reshape(-1, size).mean(axis=1)
        mean, level = float(voltage.mean()), 0.5 * float(means.min() + means.max())
        if np.isnan(current).all():
            moves = abs(mean) > STILL_V
        else:  # a wander too slow for one window shows against the window before
            moves = float(np.fmax(np.ptp(means), abs(level - before.level))) > self.still_A
        state = replace(state, memory=Plateau(0.0 if moves else before.still + self.interval, level))
        if moves or before.still < self.settling - 1e-9:  # the window must have begun settled
            return state
        return self.with_offset(state, mean, len(voltage), len(voltage) * self.sample_time)
