"""A Kalman filter with the offset voltage as second state: no lag behind the reference, and a known drift without it.

State (B, v_o): B_k = B_(k-1) + (T_s / A) ((v_k + v_(k-1)) / 2 - v_o), v_o a random walk. Every sample is predicted, and
every few milliseconds the readings of the reference are compared, on average, with the predictions of the same samples:
between two corrections the field is the coil's alone. The reference is a Hall probe, or a model of the field for the
current, whose lasting error is weighed as white noise of the density that an error of one second has.

P. Arpaia et al., Sensors 22 (2022) 182, (7) and (13), with one state; Y. Bar-Shalom, X. Li and T. Kirubarajan,
Estimation with Applications to Tracking and Navigation (Wiley, 2001), 5.2 (Kalman filter), 6.2.2 (integrated noise).
"""

from dataclasses import dataclass, replace

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.integrate.feed_forward import LastSample, increments
from femfit.integrate.field_of_current import FieldModel, MagnetState, precycled
from femfit.integrate.uncertainty import (
    FIRST_OFFSET_SIGMA_V,
    MODEL_ERROR_TIME_S,
    OFFSET_WANDER_V,
    FieldBlock,
    Noise,
    Responses,
    SensingCoil,
)
from femfit.tables.coil_record import CoilBlock

UPDATE_INTERVAL = 0.02
"""Seconds between two corrections: far below the filter's time constant of a fraction of a second."""


@dataclass(frozen=True, eq=False)
class OffsetState:
    """State of the filter after a sample."""

    last: LastSample
    # Field (T) and offset (V) at the last correction; their columns are the estimate, and the responses to the
    # reference, to a unit of it, and to a volt of unmodelled offset; shape (2, 4)
    mean: FloatArray
    covariance: FloatArray  # Covariance of field and offset at the last correction; shape (2, 2)
    # Samples since then: time (s), reading (T or A), time step (s), field increment (T), its variance; shape (5, n)
    pending: FloatArray
    magnet: MagnetState | None = None


@dataclass(frozen=True)
class OffsetFilter:
    """With a Hall probe, or with the current and a field model."""

    coil: SensingCoil
    noise: Noise
    sample_time: float
    field_model: FieldModel | None = None
    initial_field: float = float("nan")  # B_0 in T; NaN takes the reference's first reading
    offset_wander: float = OFFSET_WANDER_V  # How far the offset walks, V/sqrt(s)

    def start(self) -> OffsetState:
        """The state before the first sample."""
        mean = np.zeros((2, 4))
        mean[0, 0] = self.initial_field
        covariance = np.diag([self.noise.initial_T**2, FIRST_OFFSET_SIGMA_V**2])
        magnet = None if self.field_model is None else precycled(self.field_model.terms)
        return OffsetState(LastSample(), mean, covariance, np.zeros((5, 0)), magnet)

    def advance(self, state: OffsetState, block: CoilBlock) -> tuple[OffsetState, FieldBlock]:
        """Filter a block."""
        raw = block.hall if self.field_model is None else block.current
        if raw is None:
            name = "hall_T" if self.field_model is None else "current_A"
            raise TableError(f"This filter needs {name}; instead received a record without it.")
        before, begin = state.pending.shape[1], 0
        out = np.full((9, before + len(block)), np.nan)  # as the arrays of a FieldBlock follow each other
        if np.isnan(state.mean[0, 0]):  # nothing is known before the first reading
            begin = next(iter(np.flatnonzero(np.isfinite(raw)).tolist()), len(block))
            if begin < len(block):
                reading = float(raw[begin])  # all of the field to start from comes from the reference
                if self.field_model is not None and state.magnet is not None:
                    moment = slice(begin, begin + 1)
                    reading = float(self.field_model.advance(state.magnet, block.time[moment], raw[moment])[1][0])
                mean = state.mean.copy()
                mean[0, :3] = reading, reading, 1.0
                state = replace(state, mean=mean)
        if begin < len(block):
            last, steps = increments(state.last, block[begin:], self.coil, self.noise, self.sample_time)
            latest = np.stack([block.time[begin:], raw[begin:], steps.dt, steps.field, steps.variance])
            samples = np.concatenate([state.pending, latest], axis=1)
            window = max(1, round(UPDATE_INTERVAL / self.sample_time))
            for first in range(0, samples.shape[1], window):
                rows, target = samples[:, first : first + window], out[:, begin + first : begin + first + window]
                elapsed = self._predict(state, rows, target)
                if rows.shape[1] == window:
                    state = self._correct(state, rows, elapsed, target)
            complete = samples.shape[1] // window * window
            state = replace(state, last=last, pending=samples[:, complete:])
        field, variance, offset, innovation, spread, *answers = out[:, before:]
        return state, FieldBlock(block.time, field, variance, offset, innovation, spread, Responses(*answers))

    def _predict(self, state: OffsetState, samples: FloatArray, out: FloatArray) -> FloatArray:
        """Predict every sample since the last correction; return the times in s since then."""
        mean, P, area = state.mean, state.covariance, self.coil.area_m2
        _, _, dt, field, variance = samples
        elapsed = np.cumsum(dt)
        late = elapsed / area
        columns = mean[0, :, None] - mean[1, :, None] * late
        columns[0], columns[3] = columns[0] + np.cumsum(field), columns[3] + late
        walk = self.offset_wander**2 * late**2 * elapsed / 3.0
        spread = P[0, 0] - 2.0 * late * P[0, 1] + late**2 * P[1, 1] + np.cumsum(variance) + walk
        out[0], out[1], out[2] = columns[0], spread, mean[1, 0]
        # What the coil brought is what the reference did not
        out[5], out[6:] = columns[0] - columns[1], columns[1:]
        return elapsed

    def _correct(self, state: OffsetState, samples: FloatArray, elapsed: FloatArray, out: FloatArray) -> OffsetState:
        """Compare the mean reading with the mean prediction, at the window's last sample."""
        (time, raw, _, steps, variances), area, tau = samples, self.coil.area_m2, float(elapsed[-1])
        used = np.isfinite(raw)
        F = np.array([[1.0, -tau / area], [0.0, 1.0]])
        q = self.offset_wander**2
        walk = q * np.array([[tau**3 / (3.0 * area**2), -(tau**2) / (2.0 * area)], [-(tau**2) / (2.0 * area), tau]])
        prior = F @ state.covariance @ F.T + walk + np.diag([float(variances.sum()), 0.0])
        mean = F @ state.mean
        mean[0, 0] += float(steps.sum())
        mean[0, 3] += tau / area
        covariance, magnet = prior, state.magnet
        if used.any():
            since = float(elapsed[used].mean())
            magnet, z, R = self._reading(state.magnet, raw[used], float(time[-1]) - tau + since, tau)
            back = (tau - since) / area
            H = np.array([1.0, back])
            spread = float(H @ prior @ H) + R
            gain = prior @ H / spread
            # What the mean prediction of the readings' samples is, column by column.
            mean_prediction = H @ mean - np.array([0.0, 0.0, 0.0, back])
            mean_prediction[0] = out[0, used].mean()
            innovation = np.array([z, z, 1.0, 0.0]) - mean_prediction
            mean += gain[:, None] * innovation
            keep = np.eye(2) - np.outer(gain, H)
            covariance = keep @ prior @ keep.T + R * np.outer(gain, gain)  # Joseph's form keeps it positive
            out[3:5, -1] = innovation[0], spread
        out[:3, -1] = mean[0, 0], covariance[0, 0], mean[1, 0]
        out[5:, -1] = mean[0, 0] - mean[0, 1], *mean[0, 1:]
        return OffsetState(state.last, mean, covariance, samples[:, :0], magnet)

    def _reading(
        self, magnet: MagnetState | None, readings: FloatArray, time: float, elapsed: float
    ) -> tuple[MagnetState | None, float, float]:
        """The reference's mean field since the last correction, and its variance."""
        mean = float(readings.mean())
        if self.field_model is None or magnet is None:
            return None, mean, float(self.noise.reference.variance(readings).sum()) / len(readings) ** 2
        magnet, field = self.field_model.advance(magnet, np.array([time]), np.array([mean]))
        lasting = max(1.0, MODEL_ERROR_TIME_S / max(elapsed, self.sample_time))
        return magnet, float(field[0]), lasting * float(self.noise.reference.variance(field)[0])
