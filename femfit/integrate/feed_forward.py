"""Plain integration, and integration of the voltage minus an offset: trapezoid, FFA1, FFA2.

B_k = B_(k-1) + (T_s / A) ((v_k + v_(k-1)) / 2 - v_o). The offset v_o is nothing (trapezoid), the mean over a zero
reading at the record's begin (FFA1), or the mean over the last second in which the field stood still (FFA2).
P. Arpaia et al., Sensors 22 (2022) 182, (7) and section 3.

An offset that is the mean of m samples with white noise s each is off by s / sqrt(m), and after the time T in which it
is in use the field by T / A of that. Where W is the time for which these samples are integrated themselves, their sum
in the field is W / A times the same mean, so that the two together have the variance (s^2 / m) (W - T)^2 / A^2. The
samples' own noise, (s^2 / m) W^2 / A^2, is summed as it comes; the offset adds (s^2 / m) T (T - 2 W) / A^2. FFA2
integrates its windows, W = m T_s, and the offsets of several windows add. FFA1 leaves the zero reading out but for half
of its last sample, which stands in the first trapezoid: W = T_s / 2. Field increments are by the trapezoidal rule, from
block to block.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.integrate.uncertainty import GAP, SETTLING_S, STILL_A, STILL_V, FieldBlock, Noise, Responses, SensingCoil
from femfit.tables.coil_record import CoilBlock


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


WINDOW = 1.0
"""Seconds over which a voltage is averaged for the offset."""

BIN = 1e-3
"""Seconds over which a current is averaged before it tells a plateau: white noise of single samples grows with their
rate, and at 204.8 kS/s it would hide every plateau."""


@dataclass(frozen=True, eq=False)
class FeedForwardState:
    """State of a feed-forward integrator after a sample.

    Parameters
    ----------
    field, variance, elapsed : float
        B in T, the accumulated variance of the samples' noise, and the integrated time in s.
    offset_samples, used, former : float
        How many samples v_o is the mean of, 0 for none; the time in s in which it is in use; and the variance in T^2
        that the offsets before it have brought.
    offset, still, level : float
        v_o in V; seconds since the last ramp, or since the record's begin; the last window's current, A.
    """

    last: LastSample
    # Voltage (V) and current (A, NaN without one) of a window that is not complete yet; shape (2, n)
    window: FloatArray
    field: float
    still: float
    variance: float = 0.0
    elapsed: float = 0.0
    offset_samples: int = 0
    used: float = 0.0
    former: float = 0.0
    offset: float = 0.0
    level: float = math.nan


@dataclass(frozen=True)
class FeedForwardIntegrator:
    """Trapezoid, FFA1 with a zero reading, FFA2 on plateaus."""

    coil: SensingCoil
    noise: Noise
    sample_time: float
    initial_field: float = 0.0  # B_0 in T
    zero_reading: float = 0.0  # Seconds at the record's begin in which the field is held and the offset read
    on_plateaus: bool = False  # Whether the offset is read on plateaus, ``settling`` seconds after a ramp
    settling: float = SETTLING_S
    # A window whose current moves by less is on a plateau; without a current its mean voltage tells
    still_A: float = STILL_A
    window: float = WINDOW

    def start(self) -> FeedForwardState:
        """The state before the first sample: no ramp yet, so that the first still window counts."""
        still = math.inf if self.on_plateaus else 0.0
        return FeedForwardState(LastSample(), np.zeros((2, 0)), self.initial_field, still)

    def advance(self, state: FeedForwardState, block: CoilBlock) -> tuple[FeedForwardState, FieldBlock]:
        """Integrate a block."""
        last, steps = increments(state.last, block, self.coil, self.noise, self.sample_time)
        now, offset, reading, of_offset = (self._plateau_offsets if self.on_plateaus else self._zero_offsets)(
            state, block, steps.dt
        )
        live = 1.0 - reading
        field = state.field + np.cumsum(live * (steps.field - offset * steps.dt / self.coil.area_m2))
        walked = state.variance + np.cumsum(live * steps.variance)
        elapsed = state.elapsed + np.cumsum(live * steps.dt)
        variance = np.maximum(walked + of_offset, 0.0)  # a window's samples and its mean nearly cancel at T = W
        nothing, zero = np.full(len(block), np.nan), np.zeros(len(block))
        responses = Responses(field - self.initial_field, zero, zero, elapsed / self.coil.area_m2)
        now = replace(now, last=last, field=float(field[-1]), variance=float(walked[-1]), elapsed=float(elapsed[-1]))
        return now, FieldBlock(block.time, field, variance, offset, nothing, nothing, responses)

    def _of_offset(self, offset: FloatArray, samples: int, used: FloatArray, integrated: float) -> FloatArray:
        """Variance in T^2 that an offset adds after times in s of use, its samples being integrated for a time too."""
        of_mean = self.noise.voltage.variance(offset) / samples if samples else 0.0
        return np.asarray(of_mean * used * (used - 2.0 * integrated) / self.coil.area_m2**2)

    def _zero_offsets(
        self, state: FeedForwardState, block: CoilBlock, dt: FloatArray
    ) -> tuple[FeedForwardState, FloatArray, FloatArray, FloatArray]:
        """The state, the mean of the zero reading up to each sample, 1 for the samples that belong to it, its noise."""
        since = state.still + np.cumsum(dt)
        reading = (since < self.zero_reading - 1e-3 * self.sample_time).astype(np.float64)
        total = state.offset * state.offset_samples + np.cumsum(reading * block.voltage)
        samples = state.offset_samples + np.cumsum(reading)
        offset = total / np.maximum(samples, 1.0)
        used = state.used + np.cumsum((1.0 - reading) * dt)
        count, latest = int(samples[-1]), float(offset[-1])
        now = replace(state, still=float(since[-1]), offset=latest, offset_samples=count, used=float(used[-1]))
        return now, offset, reading, self._of_offset(offset, count, used, 0.5 * self.sample_time)

    def _plateau_offsets(
        self, state: FeedForwardState, block: CoilBlock, dt: FloatArray
    ) -> tuple[FeedForwardState, FloatArray, FloatArray, FloatArray]:
        """The state, the last settled plateau's mean at each sample, zeros as no sample is left out, and its noise."""
        size = max(1, round(self.window / self.sample_time))
        readings = np.stack([block.voltage, np.full(len(block), np.nan) if block.current is None else block.current])
        offset, of_offset = np.zeros(len(block)), np.zeros(len(block))
        now, begin = state, 0
        while begin < len(block):
            samples = slice(begin, min(len(block), begin + size - now.window.shape[1]))
            offset[samples], used = now.offset, now.used + np.cumsum(dt[samples])
            integrated = now.offset_samples * self.sample_time
            of_offset[samples] = now.former + self._of_offset(offset[samples], now.offset_samples, used, integrated)
            window = np.concatenate([now.window, readings[:, samples]], axis=1)
            now = replace(now, window=window, used=float(used[-1]))
            if window.shape[1] == size:
                now = replace(self._updated(now, float(of_offset[samples][-1])), window=window[:, :0])
            begin = samples.stop
        return now, offset, np.zeros(len(dt)), of_offset

    def _updated(self, state: FeedForwardState, brought: float) -> FeedForwardState:
        """After a complete window, whose offset holds from the next sample on; those before have brought a variance."""
        (voltage, current), still = state.window, state.still + self.window
        size = min(max(1, round(BIN / self.sample_time)), len(voltage))
        means = current[: len(current) // size * size].reshape(-1, size).mean(axis=1)
        mean, level = float(voltage.mean()), 0.5 * float(means.min() + means.max())
        if np.isnan(current).all():
            moves = abs(mean) > STILL_V
        else:  # a wander too slow for one window shows against the window before
            since = 0.0 if math.isnan(state.level) else abs(level - state.level)
            moves = max(float(np.ptp(means)), since) > self.still_A
        if moves:
            return replace(state, still=0.0, level=level)
        state, settled = replace(state, still=still, level=level), state.still >= self.settling - 1e-9
        if not settled:
            return state
        return replace(state, offset=mean, offset_samples=len(voltage), used=0.0, former=brought)
