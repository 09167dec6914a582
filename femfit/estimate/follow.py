"""A record through a filter of its model: how the filter is made, what it saw, and whether it can be relied on.

Innovations of a filter that can be are as large as it says, and white.

References
----------
Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation (Wiley, 2001),
section 5.4 (normalised innovations squared, whiteness).
R. K. Mehra, On the identification of variances and adaptive Kalman filtering, IEEE Trans. Automatic Control 15 (1970)
175 (correlation of the innovations of a gain that is too high or too low).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from femfit.core.errors import FilterError, MissingPartError, TableError
from femfit.core.numerics import NORMAL_95, FloatArray, IntArray
from femfit.core.sweep_columns import circuit_currents, voltage_columns
from femfit.estimate.constants import AT_STOP, LEAST_JUDGED, NOISE_SAMPLES
from femfit.estimate.filter import Filter
from femfit.estimate.filter_state import FilterOutcome
from femfit.estimate.kalman_filter import FilterKind, kalman_filter
from femfit.estimate.noise import ConsistencyBand, FilterNoise, consistency_band, default_noise
from femfit.estimate.prepare import Prepared, prepare
from femfit.estimate.words import sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.sensors import HALL, reading_of, sampled_readings, sensors_of
from femfit.tables.measurement import TimeSeries

FILTERS: dict[str, tuple[FilterKind, bool]] = {
    "ukf": ("ukf", False),
    "ekf": ("ekf", False),
    "ukf4": ("ukf", True),
    "ekf4": ("ekf", True),
}
"""Name -> kind, and whether a bias is a further state."""


LAGS = 20
"""Conventional: lags of the innovations' autocorrelation, in samples."""

CONFIDENCE = 0.997
"""Conventional: of the band of the mean square, which a true filter leaves as seldom as its innovations look not white.
Of 600 records of two sensors whose noise was guessed, which adds scatter, 116 left bands of 95 %, and 21 these."""


@dataclass(frozen=True, eq=False)
class Innovations:
    """Of one sensor: mean square of the normalised innovations, which should be 1, and their autocorrelation."""

    data = (
        *("sensor", "unit", "count", "rms", "mean_square", "correlation_band", "consistent", "white"),
        *("band=band.limits", "autocorrelation"),
    )

    sensor: str
    unit: str
    count: int
    mean_square: float
    band: ConsistencyBand
    autocorrelation: FloatArray  # At lags 1, 2, ...; of white innovations within +- the band's half-width in 95 %
    correlation_band: float
    rms: float  # Of the innovations themselves, in the sensor's unit

    @property
    def consistent(self) -> bool:
        """Whether the mean square lies in its band."""
        return self.band.contains(self.mean_square)

    @property
    def white(self) -> bool:
        """Whether the autocorrelation leaves its band no oftener than one lag in five, and nowhere by twice its width.

        At 20 lags a white sequence leaves the 95 % band at more than four lags in 0.3 % of cases.
        """
        return self._within(np.abs(self.autocorrelation))

    @property
    def bold(self) -> bool:
        """Whether they are larger than the filter says, or a reading's error comes back in the next ones.

        A filter that allows for more than there is follows each reading too far and takes it back in the next: its
        innovations are smaller than it says, or correlated with a negative sign, and its error is less than it claims.
        """
        return self.mean_square > self.band.upper or not self._within(self.autocorrelation)

    def _within(self, correlation: FloatArray) -> bool:
        outside = int((correlation > self.correlation_band).sum())
        return outside <= len(correlation) // 5 and not (correlation > 2.0 * self.correlation_band).any()

    @property
    def worst_lag(self) -> int:
        """Of the largest autocorrelation in magnitude, in samples."""
        return 1 + int(np.argmax(np.abs(self.autocorrelation)))


def innovations_of(sensor: str, unit: str, innovation: FloatArray, variance: FloatArray) -> Innovations | None:
    """Judge the innovations of one sensor; None where it has fewer than :data:`LEAST_JUDGED`."""
    read = np.isfinite(innovation) & np.isfinite(variance)
    count = int(read.sum())
    if count < LEAST_JUDGED:
        return None
    normalised = np.where(read, innovation / np.sqrt(np.where(read, variance, 1.0)), 0.0)
    power = float((normalised**2).sum())
    lags = np.array([float((normalised[:-k] * normalised[k:]).sum()) for k in range(1, LAGS + 1)]) / power
    return Innovations(
        sensor=sensor,
        unit=unit,
        count=count,
        mean_square=power / count,
        band=consistency_band(count, CONFIDENCE),
        autocorrelation=lags,
        correlation_band=NORMAL_95 / count**0.5,
        rms=float(np.sqrt(np.mean(innovation[read] ** 2))),
    )


@dataclass(frozen=True)
class Beside:
    """A recorded channel beside what the estimate says of it."""

    column: str
    used: bool  # Whether the filter read it
    rms: float
    mean: float  # Recorded less estimated


@dataclass(frozen=True, eq=False)
class Replayed:
    """A record as a filter saw it; arrays have one row a sample."""

    predicted: FloatArray  # Before the sample's readings; (samples, n)
    mean: FloatArray  # After them; (samples, n)
    covariance: FloatArray  # (samples, n, n)
    innovation: FloatArray  # (samples, sensors)
    variance: FloatArray  # (samples, sensors)
    outcome: IntArray  # (samples,), a :class:`FilterOutcome` each

    @cached_property
    def deviation(self) -> FloatArray:
        """Standard deviations, (samples, n)."""
        with np.errstate(invalid="ignore"):  # of a run that has lost its covariance
            return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def replay(filter_: Filter, record: Prepared, resting: Filter) -> Replayed:
    """Run a filter over all stretches of a record; where the body is held, ``resting`` steps in its place."""
    (samples, sensors), order = record.readings.shape, filter_.process.order
    shapes = (order,), (order,), (order, order), (sensors,), (sensors,)
    predicted, mean, covariance, innovation, variance = (np.empty((samples, *shape)) for shape in shapes)
    result = Replayed(predicted, mean, covariance, innovation, variance, np.empty(samples, np.intp))
    for first, rows in zip(record.first, np.split(np.arange(samples), record.begins[1:]), strict=True):
        state = filter_.update(filter_.start(first), record.readings[rows[0]])
        for k in rows.tolist():
            if k > rows[0]:  # nothing moves before a stretch's first sample
                step = resting.step if record.held[k] else filter_.step
                state = step(state, record.inputs[k], record.readings[k])
            predicted[k], mean[k], covariance[k] = state.predicted[0], state.mean[0], state.covariance[0]
            innovation[k], variance[k] = state.innovation[0], state.innovation_variance[0]
            result.outcome[k] = state.outcome[0]
    return result


@dataclass(frozen=True, eq=False)
class OneFilter:
    """A record as one filter saw it."""

    data = "name", "trusted", "cautious", "lost_at_s", "states=built.process.names", "innovations", "beside"

    name: str
    built: Filter
    noise: FilterNoise  # That it was given
    replayed: Replayed
    innovations: tuple[Innovations, ...]
    beside: tuple[Beside, ...]
    prepared: Prepared
    lost_at_s: float | None  # When it no longer ran, for whatever reason
    outcome: FilterOutcome

    @property
    def trusted(self) -> bool:
        """Whether it ran through, and its innovations are as large as it says and white; not without any judged."""
        judged = self.innovations
        return self.lost_at_s is None and bool(judged) and all(sensor.consistent and sensor.white for sensor in judged)

    @property
    def cautious(self) -> bool:
        """Whether it is not trusted only because it allows for more noise than the record has."""
        ran = self.lost_at_s is None and bool(self.innovations)
        return ran and not self.trusted and not any(sensor.bold for sensor in self.innovations)

    @property
    def sentence(self) -> str:
        """Whether it can be relied on."""
        return sentence("observe", "verdict", self)

    @property
    def claimed_m(self) -> float:
        """The deviation of the distance that it claims, root mean square over the record's second half."""
        settled = self.replayed.deviation[len(self.replayed.deviation) // 2 :, 0]
        return float(np.sqrt(np.nanmean(settled**2))) if np.isfinite(settled).any() else float("nan")

    @property
    def mean_square(self) -> float:
        """Of all normalised innovations, which should be 1."""
        ratio = self.replayed.innovation**2 / self.replayed.variance
        ratio = ratio[np.isfinite(ratio)]
        return float(ratio.mean()) if len(ratio) else float("nan")


def followed(model: ActuatorModel, series: TimeSeries) -> OneFilter | None:
    """The first samples of a record through the model's unscented filter; None where it has no filter for it.

    It needs a command, and a current, distance or Hall voltage.
    """
    names, columns = model.circuit_names, set(series.given)
    read = {*circuit_currents(names), "distance_m", "hall_V", "position_V"} & columns
    complete = model.motion is not None and set(voltage_columns(names)) <= columns
    if not (complete and read and (names or not model.has_winding)):
        return None
    try:
        return follow(prepare(model, replace(series, rows=series.rows[:NOISE_SAMPLES]), None))
    except (FilterError, MissingPartError, TableError):  # as of a coil too fast for the record, or a force law alone
        return None


def follow(
    prepared: Prepared, name: str = "ukf", biases: Sequence[str] | None = None, noise: FilterNoise | None = None
) -> OneFilter:
    """The record through one filter, with noises as given, or of the model and the record.

    A filter that does not read the recorded distance starts from it where every stretch begins with one.
    """
    kind, biased = FILTERS[name]
    chosen: Sequence[str] = ()
    if biased:
        chosen = biases or [sensor.name for sensor in prepared.sensors if sensor.unit != "A"][:1] or prepared.names[:1]
    noise = default_noise(prepared.model) if noise is None else noise
    hall = prepared.noise.get(HALL, noise.hall_V)
    noise = replace(noise, hall_V=hall, sensors={**prepared.noise, **noise.sensors})
    model, box, recorded = prepared.model, prepared.model.validity, prepared.recorded
    read, distance = {sensor.column for sensor in prepared.sensors}, recorded.get("distance_m")
    starts_recorded = "distance_m" not in read and distance is not None and np.isfinite(distance[prepared.begins]).all()
    built = kalman_filter(
        model,
        kind,
        sensors=prepared.names,
        biases=chosen,
        noise=noise,
        first_deviation_m=AT_STOP * (box.distance_max_m - box.distance_min_m) if starts_recorded else None,
    )
    resting = built
    if prepared.resting is not None:  # of a body that stands still: the current flows as in a body that nothing moves
        covariance = built.process.process_covariance.copy()
        covariance[:2, :2] = np.diag(np.square(prepared.resting))
        resting = replace(built, process=replace(built.process, held=True, process_covariance=covariance))
    replayed = replay(built, prepared, resting)
    judged = [
        innovations_of(sensor.name, sensor.unit, replayed.innovation[:, k], replayed.variance[:, k])
        for k, sensor in enumerate(prepared.sensors)
    ]
    compared: dict[str | None, Beside] = {}  # of columns with enough readings
    stretches = np.split(replayed.mean[:, : model.order], prepared.begins[1:])
    for sensor_name, sensor in sensors_of(model).items():
        column = reading_of(model, sensor_name).column
        if column not in recorded or column in compared:
            continue
        estimated = np.concatenate([sampled_readings(model, sensor, states) for states in stretches])
        missed = (recorded[column] - estimated)[np.isfinite(recorded[column] - estimated)]
        if len(missed) >= LEAST_JUDGED:
            rms = float(np.sqrt(np.mean(missed**2)))
            compared[column] = Beside(column, column in read, rms, float(missed.mean()))
    lost = np.flatnonzero(replayed.outcome != FilterOutcome.RUNNING)[:1].tolist()
    return OneFilter(
        name=name,
        built=built,
        noise=noise,
        replayed=replayed,
        innovations=tuple(innovations for innovations in judged if innovations is not None),
        beside=tuple(compared.values()),
        prepared=prepared,
        lost_at_s=float(prepared.time_s[lost[0]]) if lost else None,
        outcome=FilterOutcome(int(replayed.outcome[lost[0]])) if lost else FilterOutcome.RUNNING,
    )
