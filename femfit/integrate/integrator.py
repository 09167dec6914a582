"""The recursion that all methods share: a coil's voltage less an offset, from one correction to the next.

B_k = B_(k-1) + (T_s / A) ((v_k + v_(k-1)) / 2 - v_o). Field B and offset v_o have a covariance P, and between two
corrections the field is the coil's alone: after the time T it has the variance P_BB - 2 (T / A) P_Bo + (T / A)^2 P_oo,
the samples' own noise, and what the offset has walked. Methods differ in their corrections alone: none at all
(trapezoid), the mean voltage while the field stands still (FFA1, FFA2), a Kalman filter's with a second sensor.

P. Arpaia et al., Sensors 22 (2022) 182, (7); Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to
Tracking and Navigation (Wiley, 2001), 6.2.2 (integrated noise).
"""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.integrate.uncertainty import FieldBlock, Noise, Responses, SensingCoil
from femfit.tables.coil_record import CoilBlock

GAP = 1.5
"""Two samples further apart than this many sample times have a gap between them. Derived: 2 is one lost sample, and
half a sample time is left for jitter."""


@dataclass(frozen=True)
class LastSample:
    """Time and voltage of the last sample, NaN before the first; the largest |voltage| so far bounds a gap's secret."""

    time: float = math.nan
    voltage: float = math.nan
    highest: float = 0.0


class Increments(NamedTuple):
    """B_k - B_(k-1) of a block's samples, arrays of shape (n,)."""

    dt: FloatArray  # Since the sample before, s; 0 at a record's first sample
    field: FloatArray  # Increment in T
    variance: FloatArray  # Noise variance of the increment, T^2, with what a gap may hide


def increments(
    last: LastSample, block: CoilBlock, coil: SensingCoil, noise: Noise, sample_time: float
) -> tuple[LastSample, Increments]:
    """Trapezoids of a block, with the trapezoid that joins it to the block before.

    Two trapezoids share a sample's noise, so that the increments of n samples have the variance of n samples; the
    paper's (11) takes them as independent and arrives at half of it.
    """
    first = np.isnan(last.time)
    dt = np.diff(block.time, prepend=block.time[0] if first else last.time)
    voltage = np.concatenate([[block.voltage[0] if first else last.voltage], block.voltage])
    sample = noise.voltage.variance(voltage)
    variance = np.square(dt / coil.area_m2) * (sample[1:] + sample[:-1]) / 2.0
    for k in np.flatnonzero(dt > GAP * sample_time):
        before = max(last.highest, float(np.abs(voltage[: k + 1]).max()))
        variance[k] += (dt[k] * before / coil.area_m2) ** 2
    field = dt * (voltage[1:] + voltage[:-1]) / (2.0 * coil.area_m2)
    highest = max(last.highest, float(np.abs(block.voltage).max()))
    return LastSample(float(block.time[-1]), float(voltage[-1]), highest), Increments(dt, field, variance)


@dataclass(frozen=True, eq=False)
class IntegratorState:
    """State of an integrator after a sample."""

    last: LastSample
    # Field (T) and offset (V) at the last correction; their columns are the estimate, and the responses to the
    # reference, to a unit of it, and to a volt of unmodelled offset; shape (2, 4)
    mean: FloatArray
    covariance: FloatArray  # Covariance of field and offset at the last correction; shape (2, 2)
    # Samples since then: time (s), voltage (V), Hall probe (T), current (A), time step (s), field increment (T) and its
    # variance; NaN where there is no such reading; shape (7, n)
    pending: FloatArray
    memory: Any = None  # What a method remembers besides


@dataclass(frozen=True)
class Integrator:
    """Plain integration, and what the methods have in common."""

    coil: SensingCoil
    noise: Noise
    sample_time: float
    initial_field: float = 0.0  # B_0 in T; NaN where the first reading of a reference says it
    interval: float = math.inf  # Seconds between two corrections
    offset_wander: float = 0.0  # How far the offset walks, V/sqrt(s)

    def start(self) -> IntegratorState:
        """The state before the first sample."""
        mean = np.zeros((2, 4))
        mean[0, 0] = self.initial_field
        return IntegratorState(LastSample(), mean, np.zeros((2, 2)), np.zeros((7, 0)))

    def advance(self, state: IntegratorState, block: CoilBlock) -> tuple[IntegratorState, FieldBlock]:
        """Integrate a block."""
        before = state.pending.shape[1]
        out = np.full((9, before + len(block)), np.nan)  # as the arrays of a FieldBlock follow each other
        state, begin = self.begun(state, block, out)
        if begin < len(block):
            live = block[begin:]
            last, steps = increments(state.last, live, self.coil, self.noise, self.sample_time)
            unread = np.full(len(live), np.nan)
            readings = [unread if column is None else column for column in (live.hall, live.current)]
            samples = np.concatenate([state.pending, [live.time, live.voltage, *readings, *steps]], axis=1)
            count = samples.shape[1]
            window = count if math.isinf(self.interval) else max(1, round(self.interval / self.sample_time))
            for first in range(0, count, window):
                rows, target = samples[:, first : first + window], out[:, begin + first : begin + first + window]
                moved = self._predict(state, rows, target)
                if rows.shape[1] == window:
                    state = self.corrected(moved, rows, target)
            state = replace(state, last=last, pending=samples[:, count // window * window :])
        field, variance, offset, innovation, spread, *answers = out[:, before:]
        return state, FieldBlock(block.time, field, variance, offset, innovation, spread, Responses(*answers))

    def begun(self, state: IntegratorState, _block: CoilBlock, _out: FloatArray) -> tuple[IntegratorState, int]:
        """The state after those of the block's samples that come before the integral begins, and how many they are."""
        return state, 0

    def corrected(self, state: IntegratorState, _samples: FloatArray, _out: FloatArray) -> IntegratorState:
        """The state that goes on after a window of samples."""
        return state

    def with_offset(self, state: IntegratorState, offset: float, samples: int, integrated: float) -> IntegratorState:
        """The state that goes on with the mean of so many samples, which were integrated for a time in s."""
        of_mean = float(self.noise.voltage.variance(np.array(offset))) / samples
        across = of_mean * integrated / self.coil.area_m2
        mean = state.mean.copy()
        mean[1, 0] = offset
        return replace(state, mean=mean, covariance=np.array([[state.covariance[0, 0], across], [across, of_mean]]))

    def write(self, out: FloatArray, field: FloatArray, variance: Any, offset: Any) -> None:
        """Rows of a FieldBlock from the field with its responses, of shape (4, samples), or (4,) of one sample.

        What the coil brought is what neither the reference nor the known beginning did.
        """
        initial = 0.0 if math.isnan(self.initial_field) else self.initial_field
        out[0], out[1], out[2] = field[0], variance, offset
        out[5], out[6:] = field[0] - field[1] - initial * (1.0 - field[2]), field[1:]

    def _predict(self, state: IntegratorState, samples: FloatArray, out: FloatArray) -> IntegratorState:
        """Write down every sample since the last correction; the state at the last one."""
        mean, P, area, q = state.mean, state.covariance, self.coil.area_m2, self.offset_wander**2
        *_, dt, steps, variances = samples
        elapsed = np.cumsum(dt)
        late = elapsed / area
        columns = mean[0, :, None] - mean[1, :, None] * late
        columns[0], columns[3] = columns[0] + np.cumsum(steps), columns[3] + late
        spread = P[0, 0] - 2.0 * late * P[0, 1] + late**2 * P[1, 1] + np.cumsum(variances) + q * late**2 * elapsed / 3.0
        # The noise of samples and of their own mean nearly cancels once the mean has been in use as long
        spread = np.maximum(spread, 0.0)
        self.write(out, columns, spread, mean[1, 0])
        across = P[0, 1] - late[-1] * (P[1, 1] + 0.5 * q * elapsed[-1])
        covariance = np.array([[spread[-1], across], [across, P[1, 1] + q * elapsed[-1]]])
        return replace(state, mean=np.stack([columns[:, -1], mean[1]]), covariance=covariance)
