"""A Kalman filter with the offset voltage as second state: no lag behind the reference, and a known drift without it.

State (B, v_o): B_k = B_(k-1) + (T_s / A) ((v_k + v_(k-1)) / 2 - v_o), v_o a random walk. Every sample is predicted, and
every few milliseconds the readings of the reference are compared, on average, with the predictions of the same samples:
between two corrections the field is the coil's alone. The reference is a Hall probe (cs1-offset) or an identified model
of the field for the current (cs2-identified). What lasts of that model's error belongs to the systematics; the filter
weighs it as white noise of the density that an error of one second has.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, (7) and (13), with one state.
Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation (Wiley, 2001), 5.2
(Kalman filter), 6.2.2 (integrated white noise).
"""

from dataclasses import dataclass, replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.integrate.constants import MODEL_ERROR_TIME_S, OFFSET_SIGMA_V, OFFSET_WANDER_V
from femfit.integrate.field_block import FieldBlock, joined, leading_unknown, unknown_block
from femfit.integrate.field_of_current import FieldModel, MagnetState
from femfit.integrate.increments import Increments, LastSample, increments
from femfit.integrate.uncertainty import Noise, SensingCoil
from femfit.tables.coil_block import CoilBlock

UPDATE_INTERVAL = 0.02
"""Seconds between two corrections: far below the filter's time constant of a fraction of a second."""


@dataclass(frozen=True)
class Pending:
    """Sums since the last correction.

    Parameters
    ----------
    elapsed, integral, variance : float
        Time in s, coil's field increment in T and its noise variance in T^2.
    raw, predicted, at, noise : float
        Sums over these: reading (T or A), predicted field (T), elapsed time (s), variance (T^2).
    """

    samples: int = 0
    elapsed: float = 0.0
    integral: float = 0.0
    variance: float = 0.0
    readings: int = 0
    raw: float = 0.0
    predicted: float = 0.0
    at: float = 0.0
    noise: float = 0.0


@dataclass(frozen=True, eq=False)
class OffsetState:
    """Of the filter after a sample.

    Parameters
    ----------
    mean : array, shape (2, 4)
        Field (T) and offset (V) at the last correction; their columns are the estimate, and the responses to the
        reference, to a unit of it, and to a volt of unmodelled offset.
    covariance : array, shape (2, 2)
        At the last correction.
    """

    last: LastSample
    mean: FloatArray
    covariance: FloatArray
    pending: Pending
    magnet: MagnetState | None = None


@dataclass(frozen=True, eq=False)
class Correction:
    """One correction of the filter, for the smoother.

    Parameters
    ----------
    row : int
        Sample of the block at which it happened.
    predicted, predicted_covariance, mean, covariance : array
        Field and offset with their responses, (2, 4), and their covariance, (2, 2), before and after.
    """

    row: int
    elapsed: float
    predicted: FloatArray
    predicted_covariance: FloatArray
    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class OffsetFilter:
    """cs1-offset (Hall probe), or cs2-identified (current and a field model).

    Parameters
    ----------
    noise : Noise
        White noise of voltage and reference; the reference's is not used with a field model.
    initial_field : float
        B_0 in T; NaN takes the reference's first reading.
    offset_sigma : float
        Standard uncertainty of the offset voltage at the start, V.
    offset_wander : float
        How far the offset walks, V/sqrt(s).
    """

    coil: SensingCoil
    noise: Noise
    sample_time: float
    field_model: FieldModel | None = None
    initial_field: float = float("nan")
    offset_sigma: float = OFFSET_SIGMA_V["cs1"]
    offset_wander: float = OFFSET_WANDER_V
    interval: float = UPDATE_INTERVAL

    def start(self) -> OffsetState:
        """The state before the first sample."""
        mean = np.zeros((2, 4))
        mean[0, 0] = self.initial_field
        covariance = np.diag([self.noise.initial_T**2, self.offset_sigma**2])
        magnet = None if self.field_model is None else self.field_model.start()
        return OffsetState(LastSample(), mean, covariance, Pending(), magnet)

    def advance(
        self, state: OffsetState, block: CoilBlock, trace: list[Correction] | None = None
    ) -> tuple[OffsetState, FieldBlock]:
        """Filter a block; ``trace`` collects the corrections for the smoother."""
        raw = self._raw(block)
        unknown = leading_unknown(float(state.mean[0, 0]), raw)
        if unknown:
            before = unknown_block(block.time[:unknown])
            if unknown == len(block):
                return state, before
            state, after = self.advance(state, block[unknown:], trace)
            if trace is not None:
                trace[:] = [replace(correction, row=correction.row + unknown) for correction in trace]
            return state, joined([before, after])
        last, steps = increments(state.last, block, self.coil, self.noise, self.sample_time)
        state = replace(self._acquired(state, block.time, raw), last=last)
        size = len(block)
        out = unknown_block(block.time)
        window = max(1, round(self.interval / self.sample_time))
        begin = 0
        while begin < size:
            end = min(size, begin + window - state.pending.samples)
            state = self._predict(state, raw, steps, slice(begin, end), out)
            if state.pending.samples == window:
                state = self._correct(state, end - 1, out, trace)
            begin = end
        return state, out

    def _raw(self, block: CoilBlock) -> FloatArray:
        raw = block.hall if self.field_model is None else block.current
        if raw is None:
            name = "hall_T" if self.field_model is None else "current_A"
            raise TableError(f"This filter needs {name}; instead received a record without it.")
        return raw

    def _acquired(self, state: OffsetState, time: FloatArray, raw: FloatArray) -> OffsetState:
        """With a field to start from."""
        if not np.isnan(state.mean[0, 0]):
            return state
        first = float(raw[0])
        if self.field_model is not None and state.magnet is not None:
            first = float(self.field_model.advance(state.magnet, time[:1], raw[:1])[1][0])
        mean = state.mean.copy()
        mean[0, :3] = first, first, 1.0  # all of it came from the reference
        return replace(state, mean=mean)

    def _predict(
        self, state: OffsetState, raw: FloatArray, steps: Increments, part: slice, out: FieldBlock
    ) -> OffsetState:
        """Predict every sample of a part of the block, and sum up what the next correction needs."""
        p, mean, P, area = state.pending, state.mean, state.covariance, self.coil.area_m2
        elapsed = p.elapsed + np.cumsum(steps.dt[part])
        integral = p.integral + np.cumsum(steps.field[part])
        variance = p.variance + np.cumsum(steps.variance[part])
        late = elapsed / area
        out.field[part] = field = mean[0, 0] + integral - mean[1, 0] * late
        walk = self.offset_wander**2 * late**2 * elapsed / 3.0
        out.variance[part] = P[0, 0] - 2.0 * late * P[0, 1] + late**2 * P[1, 1] + variance + walk
        out.offset[part] = mean[1, 0]
        _write_responses(out, part, mean[0, 1:, None] - mean[1, 1:, None] * late, late)
        readings = raw[part]
        used = np.isfinite(readings)
        own = readings[used]
        return replace(
            state,
            pending=Pending(
                p.samples + len(elapsed),
                float(elapsed[-1]),
                float(integral[-1]),
                float(variance[-1]),
                p.readings + len(own),
                p.raw + float(own.sum()),
                p.predicted + float(field[used].sum()),
                p.at + float(elapsed[used].sum()),
                p.noise + float(self.noise.reference.variance(own).sum()),
            ),
        )

    def _correct(self, state: OffsetState, row: int, out: FieldBlock, trace: list[Correction] | None) -> OffsetState:
        """Compare the mean reading with the mean prediction, at the window's last sample."""
        p, area, tau = state.pending, self.coil.area_m2, state.pending.elapsed
        F = np.array([[1.0, -tau / area], [0.0, 1.0]])
        q = self.offset_wander**2
        walk = q * np.array([[tau**3 / (3.0 * area**2), -(tau**2) / (2.0 * area)], [-(tau**2) / (2.0 * area), tau]])
        prior = F @ state.covariance @ F.T + walk + np.diag([p.variance, 0.0])
        mean = F @ state.mean
        mean[0, 0] += p.integral
        mean[0, 3] += tau / area
        predicted, covariance, magnet = mean.copy(), prior, state.magnet
        if p.readings:
            magnet, z = self._reading(state, float(out.time[row]))
            back = (tau - p.at / p.readings) / area
            H = np.array([1.0, back])
            R = self._reading_variance(p)
            spread = float(H @ prior @ H) + R
            gain = prior @ H / spread
            # What the mean prediction of the readings' samples is, column by column.
            mean_prediction = H @ mean - np.array([0.0, 0.0, 0.0, back])
            mean_prediction[0] = p.predicted / p.readings
            innovation = np.array([z, z, 1.0, 0.0]) - mean_prediction
            mean += gain[:, None] * innovation
            keep = np.eye(2) - np.outer(gain, H)
            covariance = keep @ prior @ keep.T + R * np.outer(gain, gain)  # Joseph's form keeps it positive
            out.innovation[row], out.innovation_variance[row] = innovation[0], spread
        out.field[row], out.offset[row], out.variance[row] = mean[0, 0], mean[1, 0], covariance[0, 0]
        _write_responses(out, slice(row, row + 1), mean[0, 1:, None], np.zeros(1))
        if trace is not None:
            trace.append(Correction(row, tau, predicted, prior, mean, covariance))
        return OffsetState(state.last, mean, covariance, Pending(), magnet)

    def _reading(self, state: OffsetState, time: float) -> tuple[MagnetState | None, float]:
        """The reference's mean field since the last correction."""
        p = state.pending
        mean = p.raw / p.readings
        if self.field_model is None or state.magnet is None:
            return None, mean
        magnet, field = self.field_model.advance(
            state.magnet, np.array([time - p.elapsed + p.at / p.readings]), np.array([mean])
        )
        return magnet, float(field[0])

    def _reading_variance(self, p: Pending) -> float:
        """Of the mean reading."""
        if self.field_model is None:
            return p.noise / p.readings**2
        return self.field_model.rms_T**2 * max(1.0, MODEL_ERROR_TIME_S / max(p.elapsed, self.sample_time))


def _write_responses(out: FieldBlock, part: slice, rows: FloatArray, late: FloatArray) -> None:
    """Responses of the predictions: what the coil brought is what the reference did not."""
    reference, unit, voltage = rows
    out.responses.coil[part] = out.field[part] - reference
    out.responses.reference[part] = reference
    out.responses.reference_unit[part] = unit
    out.responses.voltage_unit[part] = voltage + late
