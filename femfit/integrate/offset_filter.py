"""A Kalman filter with the offset voltage as second state: no lag behind the reference, and a known drift without it.

State (B, v_o), v_o a random walk. Every sample is predicted, and every few milliseconds the readings of the reference
are compared, on average, with the predictions of the same samples. The reference is a Hall probe, or a model of the
field for the current, whose lasting error is weighed as white noise of the density that an error of one second has.

P. Arpaia et al., Sensors 22 (2022) 182, (7) and (13), with one state; Y. Bar-Shalom, X. Li and T. Kirubarajan,
Estimation with Applications to Tracking and Navigation (Wiley, 2001), 5.2 (Kalman filter).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.integrate.field_of_current import FieldModel, precycled
from femfit.integrate.integrator import Integrator, IntegratorState
from femfit.tables.coil_record import CoilBlock

UPDATE_INTERVAL = 0.02
"""Seconds between two corrections: far below the filter's time constant of a fraction of a second."""

FIRST_OFFSET_SIGMA_V = 20e-6
"""Standard deviation of the offset voltage when a record begins. Chosen: an amplifier's own offset."""

OFFSET_WANDER_V = 1e-6
"""How far the offset voltage walks in a second, V/sqrt(s). Chosen: a few microvolts in ten seconds, as instrumentation
amplifiers do."""

MODEL_ERROR_TIME_S = 1.0
"""For so long an error of the current's field counts as noise; weighed as lasting longer, the offset would drift after
it. Chosen: the scale of a ramp."""


@dataclass(frozen=True)
class OffsetFilter(Integrator):
    """With a Hall probe, or with the current and a field model."""

    initial_field: float = math.nan  # NaN takes the reference's first reading
    interval: float = UPDATE_INTERVAL
    offset_wander: float = OFFSET_WANDER_V
    field_model: FieldModel | None = None

    def start(self) -> IntegratorState:
        """The state before the first sample."""
        covariance = np.diag([self.noise.initial_T**2, FIRST_OFFSET_SIGMA_V**2])
        magnet = None if self.field_model is None else precycled(self.field_model.terms)
        return replace(super().start(), covariance=covariance, memory=magnet)

    def begun(self, state: IntegratorState, block: CoilBlock, _out: FloatArray) -> tuple[IntegratorState, int]:
        """Pass over samples before the first reading, where nothing is known: all of the field comes from that."""
        name, reading = ("hall_T", block.hall) if self.field_model is None else ("current_A", block.current)
        if reading is None:
            raise TableError(f"This filter needs {name}; instead received a record without it.")
        if not math.isnan(state.mean[0, 0]):
            return state, 0
        read = np.flatnonzero(np.isfinite(reading))
        if not len(read):
            return state, len(block)
        first = reading[read[:1]]
        if self.field_model is not None:
            first = self.field_model.advance(state.memory, block.time[read[:1]], first)[1]
        mean = state.mean.copy()
        mean[0, :3] = first[0], first[0], 1.0
        return replace(state, mean=mean), int(read[0])

    def corrected(self, state: IntegratorState, samples: FloatArray, out: FloatArray) -> IntegratorState:
        """Compare the mean reading with the mean prediction, at the window's last sample."""
        time, _, hall, current, dt, *_ = samples
        mean, prior, raw = state.mean, state.covariance, hall if self.field_model is None else current
        used = np.isfinite(raw)
        if not used.any():
            return state
        elapsed = np.cumsum(dt)
        tau, since = float(elapsed[-1]), float(elapsed[used].mean())
        # The reference's mean field since the last correction, and its variance
        magnet, z = None, float(raw[used].mean())
        R = float(self.noise.reference.variance(raw[used]).mean()) / int(used.sum())
        if self.field_model is not None:
            moment = np.array([time[-1] - tau + since])
            magnet, field = self.field_model.advance(state.memory, moment, np.array([z]))
            z, lasting = float(field[0]), max(1.0, MODEL_ERROR_TIME_S / max(tau, self.sample_time))
            R = lasting * float(self.noise.reference.variance(field)[0])
        back = (tau - since) / self.coil.area_m2
        H = np.array([1.0, back])
        spread = float(H @ prior @ H) + R
        gain = prior @ H / spread
        # What the mean prediction of the readings' samples is, column by column
        mean_prediction = H @ mean - np.array([0.0, 0.0, 0.0, back])
        mean_prediction[0] = out[0, used].mean()
        innovation = np.array([z, z, 1.0, 0.0]) - mean_prediction
        mean = mean + gain[:, None] * innovation
        unread = np.eye(2) - np.outer(gain, H)
        covariance = unread @ prior @ unread.T + R * np.outer(gain, gain)  # Joseph's form keeps it positive
        out[3:5, -1] = innovation[0], spread
        self.write(out[:, -1], mean[0], covariance[0, 0], mean[1, 0])
        return replace(state, mean=mean, covariance=covariance, memory=magnet)
