"""Plain integration, and integration of the voltage minus an offset: trapezoid, FFA1, FFA2.

B_k = B_(k-1) + (T_s / A) ((v_k + v_(k-1)) / 2 - v_o). The offset v_o is nothing (trapezoid), the mean over a zero
reading at the record's begin (FFA1), or the mean over the last second in which the field stood still (FFA2).
P. Arpaia et al., Sensors 22 (2022) 182, (7) and section 3.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.integrate.constants import SETTLING_S, STILL_A, STILL_V
from femfit.integrate.increments import LastSample, increments
from femfit.integrate.uncertainty import FieldBlock, Noise, Responses, SensingCoil
from femfit.tables.coil_block import CoilBlock

WINDOW = 1.0
"""Seconds over which a voltage is averaged for the offset."""

BIN = 1e-3
"""Seconds over which a current is averaged before it tells a plateau: white noise of single samples grows with their
rate, and at 204.8 kS/s it would hide every plateau."""


@dataclass(frozen=True)
class Window:
    """Sums over the samples of a window that is not complete yet, or of the zero reading."""

    samples: int = 0
    voltage_sum: float = 0.0
    # Extremes of the current's means over :data:`BIN`, A; infinite without a current
    current_min: float = math.inf
    current_max: float = -math.inf
    # Sum (A) and number of the samples of a mean that is not complete yet; at the window's end it is left out
    bin_sum: float = 0.0
    bin_samples: int = 0

    def extended(self, voltage: FloatArray, current: FloatArray | None, bin_size: int) -> "Window":
        """With more samples; the current is averaged over ``bin_size`` of them."""
        low, high, bin_sum, bin_samples = self.current_min, self.current_max, self.bin_sum, self.bin_samples
        if current is not None:
            starts = np.concatenate([[0], np.arange(bin_size - bin_samples, len(current), bin_size)])
            sums = np.add.reduceat(current, starts)
            counts = np.diff(starts, append=len(current))
            sums[0], counts[0] = sums[0] + bin_sum, counts[0] + bin_samples
            means = sums[counts == bin_size] / bin_size
            low, high = float(means.min(initial=low)), float(means.max(initial=high))
            full = counts[-1] == bin_size
            bin_sum, bin_samples = (0.0, 0) if full else (float(sums[-1]), int(counts[-1]))
        total = self.voltage_sum + float(np.sum(voltage))
        return Window(self.samples + len(voltage), total, low, high, bin_sum, bin_samples)


@dataclass(frozen=True)
class FeedForwardState:
    """State of a feed-forward integrator after a sample.

    Parameters
    ----------
    field, variance, elapsed : float
        B in T, its accumulated noise variance, and the integrated time in s.
    offset, still, level : float
        v_o in V; seconds since the last ramp, or since the record's begin; the last window's current, A.
    """

    last: LastSample
    field: float
    still: float
    variance: float = 0.0
    elapsed: float = 0.0
    offset: float = 0.0
    level: float = math.nan
    window: Window = Window()  # frozen


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
        return FeedForwardState(LastSample(), self.initial_field, math.inf if self.on_plateaus else 0.0)

    def advance(self, state: FeedForwardState, block: CoilBlock) -> tuple[FeedForwardState, FieldBlock]:
        """Integrate a block."""
        last, steps = increments(state.last, block, self.coil, self.noise, self.sample_time)
        now, offset, reading = (self._plateau_offsets if self.on_plateaus else self._zero_offsets)(
            state, block, steps.dt
        )
        live = 1.0 - reading
        field = state.field + np.cumsum(live * (steps.field - offset * steps.dt / self.coil.area_m2))
        variance = state.variance + np.cumsum(live * steps.variance)
        elapsed = state.elapsed + np.cumsum(live * steps.dt)
        nothing, zero = np.full(len(block), np.nan), np.zeros(len(block))
        responses = Responses(field - self.initial_field, zero, zero, elapsed / self.coil.area_m2)
        now = replace(now, last=last, field=float(field[-1]), variance=float(variance[-1]), elapsed=float(elapsed[-1]))
        return now, FieldBlock(block.time, field, variance, offset, nothing, nothing, responses)

    def _zero_offsets(
        self, state: FeedForwardState, block: CoilBlock, dt: FloatArray
    ) -> tuple[FeedForwardState, FloatArray, FloatArray]:
        """The state, the mean of the zero reading up to each sample, and 1 for the samples that belong to it."""
        since = state.still + np.cumsum(dt)
        reading = (since < self.zero_reading - 1e-3 * self.sample_time).astype(np.float64)
        total = state.window.voltage_sum + np.cumsum(reading * block.voltage)
        samples = state.window.samples + np.cumsum(reading)
        offset = total / np.maximum(samples, 1.0)
        seen = Window(int(samples[-1]), float(total[-1]))
        return replace(state, still=float(since[-1]), offset=float(offset[-1]), window=seen), offset, reading

    def _plateau_offsets(
        self, state: FeedForwardState, block: CoilBlock, dt: FloatArray
    ) -> tuple[FeedForwardState, FloatArray, FloatArray]:
        """The state, the last settled plateau's mean at each sample, and zeros: no sample is left out."""
        size = max(1, round(self.window / self.sample_time))
        bin_size = min(max(1, round(BIN / self.sample_time)), size)
        offset = np.zeros(len(block))
        now, begin = state, 0
        while begin < len(block):
            part = slice(begin, min(len(block), begin + size - now.window.samples))
            offset[part] = now.offset
            current = None if block.current is None else block.current[part]
            now = replace(now, window=now.window.extended(block.voltage[part], current, bin_size))
            if now.window.samples == size:
                now = replace(self._updated(now), window=Window())
            begin = part.stop
        return now, offset, np.zeros(len(dt))

    def _updated(self, state: FeedForwardState) -> FeedForwardState:
        """After a complete window, whose offset holds from the next sample on."""
        seen, still = state.window, state.still + self.window
        mean, level = seen.voltage_sum / seen.samples, 0.5 * (seen.current_min + seen.current_max)
        if math.isinf(seen.current_min):
            moves = abs(mean) > STILL_V
        else:  # a wander too slow for one window shows against the window before
            since = 0.0 if math.isnan(state.level) else abs(level - state.level)
            moves = max(seen.current_max - seen.current_min, since) > self.still_A
        if moves:
            return replace(state, still=0.0, level=level)
        settled = state.still >= self.settling - 1e-9
        return replace(state, offset=mean if settled else state.offset, still=still, level=level)
