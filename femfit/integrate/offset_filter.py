"""A Kalman filter with the offset voltage as second state: no lag behind the reference, and a known drift without it.

State (B, v_o): B_k = B_(k-1) + (T_s / A) ((v_k + v_(k-1)) / 2 - v_o), v_o a random walk. Every sample is predicted, and
every few milliseconds the readings of the reference are compared, on average, with the predictions of the same samples:
between two corrections the field is the coil's alone. The reference is a Hall probe, or a model of the field for the
current, whose lasting error is weighed as white noise of the density that an error of one second has.

P. Arpaia et al., Sensors 22 (2022) 182, (7) and (13), with one state; Y. Bar-Shalom, X. Li and T. Kirubarajan,
Estimation with Applications to Tracking and Navigation (Wiley, 2001), 5.2 (Kalman filter), 6.2.2 (integrated noise).

Offline, a smoother says what the filter would have said had it known the rest of the record. H. E. Rauch, F. Tung and
C. T. Striebel, AIAA J. 3 (1965) 1445. The backward recursion goes from correction to correction, and the coil's
integral carries the samples between.
"""

from dataclasses import dataclass, replace

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.integrate.constants import FIRST_OFFSET_SIGMA_V, MODEL_ERROR_TIME_S, OFFSET_WANDER_V
from femfit.integrate.feed_forward import Increments, LastSample, increments
from femfit.integrate.field_of_current import FieldModel, MagnetState
from femfit.integrate.uncertainty import FieldBlock, Noise, Responses, SensingCoil
from femfit.tables.coil_record import CoilBlock

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
        Sums over the readings: reading (T or A), predicted field (T), elapsed time (s), variance (T^2).
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
    """State of the filter after a sample."""

    last: LastSample
    # Field (T) and offset (V) at the last correction; their columns are the estimate, and the responses to the
    # reference, to a unit of it, and to a volt of unmodelled offset; shape (2, 4)
    mean: FloatArray
    covariance: FloatArray  # Covariance of field and offset at the last correction; shape (2, 2)
    pending: Pending
    magnet: MagnetState | None = None


@dataclass(frozen=True, eq=False)
class Correction:
    """One correction of the filter, for the smoother: at which sample of the block, and what was before and after."""

    row: int
    elapsed: float
    predicted: FloatArray
    predicted_covariance: FloatArray
    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class OffsetFilter:
    """With a Hall probe, or with the current and a field model."""

    coil: SensingCoil
    noise: Noise
    sample_time: float
    field_model: FieldModel | None = None
    initial_field: float = float("nan")  # B_0 in T; NaN takes the reference's first reading
    offset_sigma: float = FIRST_OFFSET_SIGMA_V  # Standard uncertainty of the offset voltage at the start, V
    offset_wander: float = OFFSET_WANDER_V  # How far the offset walks, V/sqrt(s)
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
        raw = block.hall if self.field_model is None else block.current
        if raw is None:
            name = "hall_T" if self.field_model is None else "current_A"
            raise TableError(f"This filter needs {name}; instead received a record without it.")
        field, variance, offset, innovation, spread, of_gain, *answers = np.full((10, len(block)), np.nan)
        out = FieldBlock(block.time, field, variance, offset, innovation, spread, of_gain, Responses(*answers))
        begin = 0
        if np.isnan(state.mean[0, 0]):  # nothing is known before the first reading
            begin = next(iter(np.flatnonzero(np.isfinite(raw)).tolist()), len(block))
            if begin == len(block):
                return state, out
            state = self._acquired(state, block.time[begin], raw[begin])
        last, steps = increments(state.last, block[begin:], self.coil, self.noise, self.sample_time)
        window, first = max(1, round(self.interval / self.sample_time)), begin
        while begin < len(block):
            end = min(len(block), begin + window - state.pending.samples)
            state = self._predict(state, raw[begin:end], steps, slice(begin - first, end - first), out, begin)
            if state.pending.samples == window:
                state = self._correct(state, end - 1, out, trace)
            begin = end
        return replace(state, last=last), out

    def _acquired(self, state: OffsetState, time: float, reading: float) -> OffsetState:
        """With a field to start from, all of which came from the reference."""
        if self.field_model is not None and state.magnet is not None:
            reading = float(self.field_model.advance(state.magnet, np.array([time]), np.array([reading]))[1][0])
        mean = state.mean.copy()
        mean[0, :3] = reading, reading, 1.0
        return replace(state, mean=mean)

    def _predict(
        self, state: OffsetState, readings: FloatArray, steps: Increments, rows: slice, out: FieldBlock, begin: int
    ) -> OffsetState:
        """Predict every sample of a part of the block, and sum up what the next correction needs."""
        p, mean, P, area = state.pending, state.mean, state.covariance, self.coil.area_m2
        elapsed = p.elapsed + np.cumsum(steps.dt[rows])
        integral = p.integral + np.cumsum(steps.field[rows])
        variance = p.variance + np.cumsum(steps.variance[rows])
        late, samples = elapsed / area, slice(begin, begin + len(elapsed))
        out.field[samples] = field = mean[0, 0] + integral - mean[1, 0] * late
        walk = self.offset_wander**2 * late**2 * elapsed / 3.0
        out.variance[samples] = P[0, 0] - 2.0 * late * P[0, 1] + late**2 * P[1, 1] + variance + walk
        out.offset[samples] = mean[1, 0]
        _write_responses(out, samples, mean[0, 1:, None] - mean[1, 1:, None] * late, late)
        used = np.isfinite(readings)
        means = readings[used]
        noise = 0.0 if self.field_model is not None else float(self.noise.reference.variance(means).sum())
        pending = Pending(
            p.samples + len(elapsed),
            float(elapsed[-1]),
            float(integral[-1]),
            float(variance[-1]),
            p.readings + len(means),
            p.raw + float(means.sum()),
            p.predicted + float(field[used].sum()),
            p.at + float(elapsed[used].sum()),
            p.noise + noise,
        )
        return replace(state, pending=pending)

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
            magnet, z, R = self._reading(state, float(out.time[row]))
            back = (tau - p.at / p.readings) / area
            H = np.array([1.0, back])
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
            out.innovation_gain[row] = innovation[1]
        out.field[row], out.offset[row], out.variance[row] = mean[0, 0], mean[1, 0], covariance[0, 0]
        _write_responses(out, slice(row, row + 1), mean[0, 1:, None], np.zeros(1))
        if trace is not None:
            trace.append(Correction(row, tau, predicted, prior, mean, covariance))
        return OffsetState(state.last, mean, covariance, Pending(), magnet)

    def _reading(self, state: OffsetState, time: float) -> tuple[MagnetState | None, float, float]:
        """The reference's mean field since the last correction, and its variance."""
        p = state.pending
        mean = p.raw / p.readings
        if self.field_model is None or state.magnet is None:
            return None, mean, p.noise / p.readings**2
        times = np.array([time - p.elapsed + p.at / p.readings])
        magnet, field = self.field_model.advance(state.magnet, times, np.array([mean]))
        lasting = max(1.0, MODEL_ERROR_TIME_S / max(p.elapsed, self.sample_time))
        return magnet, float(field[0]), lasting * float(self.noise.reference.variance(field)[0])


def _write_responses(out: FieldBlock, samples: slice, rows: FloatArray, late: FloatArray) -> None:
    """Responses of the predictions: what the coil brought is what the reference did not."""
    reference, unit, voltage = rows
    out.responses.coil[samples] = out.field[samples] - reference
    out.responses.reference[samples] = reference
    out.responses.reference_unit[samples] = unit
    out.responses.voltage_unit[samples] = voltage + late


def smooth(integrator: OffsetFilter, record: CoilBlock) -> FieldBlock:
    """Filter a whole record and smooth it; innovations stay the filter's."""
    trace: list[Correction] = []
    start = integrator.start()
    _, out = integrator.advance(start, record, trace)
    if not trace:
        return out
    area = integrator.coil.area_m2
    means, variances = _smoothed_corrections(trace, area)
    _, steps = increments(start.last, record, integrator.coil, integrator.noise, integrator.sample_time)
    time = record.time
    # What moves the columns of the mean between corrections: the coil, nothing, nothing, and a volt of offset.
    moved = np.zeros((len(time), 4))
    moved[:, 0], moved[:, 3] = np.cumsum(steps.field), (time - time[0]) / area
    values, offset, variance = np.full((len(time), 4), np.nan), out.offset.copy(), out.variance.copy()
    for place in range(len(trace) - 1):
        begin, end = trace[place].row, trace[place + 1].row
        rows = slice(begin, end + 1)
        since = (time[rows] - time[begin])[:, None]
        path = means[place, 0] + moved[rows] - moved[begin] - means[place, 1] * since / area
        # What the walk of the offset moved is spread over the interval, so that the path meets the next correction.
        share = since / since[-1]
        values[rows] = path + (means[place + 1, 0] - path[-1]) * share
        offset[rows] = means[place, 1, 0] + (means[place + 1, 1, 0] - means[place, 1, 0]) * share[:, 0]
        variance[rows] = variances[place] + (variances[place + 1] - variances[place]) * share[:, 0]
    first = int(np.flatnonzero(np.isfinite(out.field))[0])
    for columns, row, mean in (
        (slice(first, trace[0].row + 1), trace[0].row, means[0]),
        (slice(trace[-1].row, None), trace[-1].row, means[-1]),
    ):
        values[columns] = mean[0] + moved[columns] - moved[row] - mean[1] * (time[columns] - time[row])[:, None] / area
    offset[first : trace[0].row], variance[first : trace[0].row] = means[0, 1, 0], variances[0]
    field, reference, unit, voltage = np.ascontiguousarray(values.T)
    responses = Responses(field - reference, reference, unit, voltage)
    return replace(out, field=field, variance=variance, offset=offset, responses=responses)


def _smoothed_corrections(trace: list[Correction], area: float) -> tuple[FloatArray, FloatArray]:
    """Smoothed field and offset with their responses (n, 2, 4), and the field's variance (n,), at the corrections."""
    means, variances = np.empty((len(trace), 2, 4)), np.empty(len(trace))
    mean, covariance = trace[-1].mean, trace[-1].covariance
    means[-1], variances[-1] = mean, covariance[0, 0]
    for place in range(len(trace) - 2, -1, -1):
        here, after = trace[place], trace[place + 1]
        F = np.array([[1.0, -after.elapsed / area], [0.0, 1.0]])
        gain = np.linalg.solve(after.predicted_covariance, F @ here.covariance).T
        mean = here.mean + gain @ (mean - after.predicted)
        smoothed = here.covariance + gain @ (covariance - after.predicted_covariance) @ gain.T
        # Across a gap of days rounding may eat all of it; the filter's own covariance is on the safe side.
        covariance = smoothed if smoothed[0, 0] > 0.0 else here.covariance
        means[place], variances[place] = mean, covariance[0, 0]
    return means, variances
