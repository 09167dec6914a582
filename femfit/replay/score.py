"""What a filter makes of a record, in few numbers, by which two models are compared.

Both models' filters are given the same noises, so that the likelihood of the innovations tells the models apart and not
their noises. A channel that the filter does not read checks it.

References
----------
Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation (Wiley, 2001),
section 5.4 (likelihood of the innovations).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import FilterError, MissingPartError, TableError
from femfit.core.sweep_columns import circuit_currents, voltage_columns
from femfit.filters.constants import OBSERVED_SHARE
from femfit.filters.filter_state import FilterOutcome
from femfit.filters.noise import FilterNoise
from femfit.model.actuator_model import ActuatorModel
from femfit.replay.build_filter import filter_of, noise_of, resting_filter
from femfit.replay.prepare import prepare, recorded_sensors, with_recorded_sensors
from femfit.replay.run_filter import replay
from femfit.replay.unread import estimates_beside
from femfit.tables.measurement import TimeSeries


@dataclass(frozen=True, eq=False)
class FilterScore:
    """A record as the filter of one model saw it."""

    sensors: tuple[str, ...]  # That the filter read
    likelihood: FloatArray  # Logarithm, of each sample that has a reading; NaN elsewhere; (samples,)
    mean_square: float  # Of the normalised innovations, which should be 1
    # Recorded less estimated, of each channel that it did not read; NaN where it claims to be blind; (samples,)
    unread: Mapping[str, FloatArray]
    lost_at_s: float | None


def can_be_filtered(model: ActuatorModel, series: TimeSeries) -> bool:
    """Whether a record has what a filter of this model needs: a command, and a current, distance or Hall voltage."""
    names = model.circuit_names
    complete = model.motion is not None and set(voltage_columns(names)) <= set(series.given)
    read = {*circuit_currents(names), "distance_m", "hall_V", "position_V"} & set(series.given)
    return complete and (bool(names) or not model.has_winding) and bool(read)


def filter_score(
    model: ActuatorModel,
    series: TimeSeries,
    without: Sequence[str] = (),
    noise: FilterNoise | None = None,
) -> FilterScore | None:
    """Run the unscented filter of a model over a record; None where the model has no filter for it.

    Parameters
    ----------
    without : sequence of str
        Columns that it does not read.
    noise : FilterNoise or None
        Of the model where None; that of the sensors is the record's.
    """
    if not can_be_filtered(model, series):
        return None
    try:
        sensors = recorded_sensors(with_recorded_sensors(model, series), series, without)
        prepared = prepare(model, series, sensors)
        built = filter_of(prepared, "ukf", None, noise_of(prepared, noise))
    except (FilterError, MissingPartError, TableError):  # as of a coil too fast for the record, or a force law alone
        return None
    replayed = replay(built, prepared.log, resting_filter(prepared, built))
    ratio = replayed.innovation**2 / replayed.variance
    read = np.isfinite(ratio)
    each = np.where(read, -0.5 * (ratio + np.log(np.where(read, replayed.variance, 1.0))), 0.0).sum(axis=1)
    lost = np.flatnonzero(~np.isin(replayed.outcome, (FilterOutcome.RUNNING, FilterOutcome.INNOVATIONS_OUT_OF_BAND)))
    used = {reading.column for reading in prepared.readings}
    beside = estimates_beside(prepared, replayed)
    first = float(np.sqrt(built.process.require_start_covariance()[0, 0]))
    sees = replayed.deviation[:, 0] < OBSERVED_SHARE * first
    return FilterScore(
        sensors=prepared.sensors,
        likelihood=np.where(read.any(axis=1), each, np.nan),
        mean_square=float(ratio[read].mean()) if read.any() else float("nan"),
        unread={
            name: np.where(sees, prepared.recorded[name] - values, np.nan)
            for name, values in beside.items()
            if name not in used
        },
        lost_at_s=float(prepared.time_s[lost[0]]) if len(lost) else None,
    )
