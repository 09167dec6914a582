"""States of a filter that are what a sensor had at earlier samples, for readings that are late or are differences.

Behind the states of the model and the biases stand, for each such sensor, g(x_(k-1)), g(x_(k-2)), .. of
:mod:`femfit.model.sensors`. They move on by one place a sample, and a reading is linear in them.

References
----------
B. D. O. Anderson and J. B. Moore, Optimal Filtering (Prentice-Hall, 1979), chapter 7: fixed-lag smoothing as filtering
of a state that earlier ones are added to.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.errors import FilterError
from femfit.core.numerics import FloatArray, central_differences
from femfit.estimate.constants import MOST_DELAYED_SAMPLES
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import PickupSensor
from femfit.model.sensing import AnySensor
from femfit.model.sensors import reading_of, sample_weights, sampled_value, unit_in_name


@dataclass(frozen=True, eq=False)
class SensorSamples:
    """What is remembered of one sensor."""

    name: str
    sensor: AnySensor
    first: int  # Place of its first state
    weights: FloatArray  # c_0, c_1, .. of a reading

    @property
    def count(self) -> int:
        """States of this sensor."""
        return len(self.weights) - 1


@dataclass(frozen=True, eq=False)
class DelayedSamples:
    """All that a filter remembers; places from ``base`` on are these states'."""

    model: ActuatorModel
    base: int  # States of the model and biases
    by_sensor: tuple[SensorSamples, ...]
    scale: FloatArray  # Deviations of the first ``base`` states, over which slopes are taken

    @property
    def names(self) -> tuple[str, ...]:
        """Of the states, with their units; a pickup coil's are flux linkages."""
        units = [
            "Wb"
            if isinstance(samples.sensor, PickupSensor)
            else unit_in_name(reading_of(self.model, samples.name).unit)
            for samples in self.by_sensor
        ]
        pairs = zip(self.by_sensor, units, strict=True)
        return tuple(f"{samples.name}_before_{k + 1}_{unit}" for samples, unit in pairs for k in range(samples.count))

    @property
    def order(self) -> int:
        """Number of these states."""
        return sum(samples.count for samples in self.by_sensor)

    def of_sensor(self, name: str) -> SensorSamples | None:
        """What is remembered of a sensor."""
        return next((samples for samples in self.by_sensor if samples.name == name), None)

    def values(self, samples: SensorSamples, states: FloatArray) -> FloatArray:
        """G at states (N, n), of shape (N,)."""
        return sampled_value(self.model, samples.sensor, states[:, : self.model.order])

    def slope(self, samples: SensorSamples, states: FloatArray) -> FloatArray:
        """dg/dx in the first ``base`` states, (N, base), by differences."""
        return central_differences(
            lambda points: self.values(samples, points)[:, None], states[:, : self.base], self.scale
        )[:, 0, :]

    def moved(self, base: FloatArray, before: FloatArray) -> FloatArray:
        """All states one sample later, from the first ones (N, base) of then and all of before (N, n)."""
        result = np.empty((before.shape[1], len(before))).T
        result[:, : self.base] = base[:, : self.base]
        for samples in self.by_sensor:
            end = samples.first + samples.count
            result[:, samples.first] = self.values(samples, before)
            result[:, samples.first + 1 : end] = before[:, samples.first : end - 1]
        return result

    def jacobian(self, base: FloatArray, before: FloatArray) -> FloatArray:
        """Jacobian of :meth:`moved` from that of the first states, (N, base, base)."""
        n = before.shape[1]
        result = np.zeros((len(before), n, n))
        result[:, : self.base, : self.base] = base
        for samples in self.by_sensor:
            later = range(samples.first + 1, samples.first + samples.count)
            result[:, samples.first, : self.base] = self.slope(samples, before)
            result[:, later, [k - 1 for k in later]] = 1.0
        return result

    def from_rest(self, mean: FloatArray) -> FloatArray:
        """A first estimate (..., base) with what was remembered if nothing had moved before."""
        rows = mean.reshape(-1, self.base)
        parts = [np.repeat(self.values(samples, rows)[:, None], samples.count, axis=1) for samples in self.by_sensor]
        return np.concatenate([rows, *parts], axis=1).reshape(*mean.shape[:-1], -1)


def delayed_samples(model: ActuatorModel, sensors: dict[str, AnySensor], scale: FloatArray) -> DelayedSamples | None:
    """What sensors ask to be remembered; None where all are prompt.

    Parameters
    ----------
    scale : array, shape (base,)
        Deviations of a first estimate.

    Raises
    ------
    FilterError
        If a delay is longer than a filter remembers.
    """
    place, remembered = len(scale), []
    for name, sensor in sensors.items():
        if sensor.delay_s > MOST_DELAYED_SAMPLES * model.sample_time_s:
            raise FilterError(
                f"A filter remembers {MOST_DELAYED_SAMPLES} samples at most; sensor {name!r} is late by "
                f"{1e3 * sensor.delay_s:g} ms, which are {sensor.delay_s / model.sample_time_s:.0f}. Lengthen the "
                "sample time, or leave the sensor out."
            )
        weights = sample_weights(sensor, model.sample_time_s)
        if len(weights) > 1:
            remembered.append(SensorSamples(name, sensor, place, weights))
            place += len(weights) - 1
    return DelayedSamples(model, len(scale), tuple(remembered), scale) if remembered else None


def delayed_variances(delayed: DelayedSamples, places: FloatArray) -> FloatArray:
    """First variances of the states that are remembered: the largest over places (N, base), independent of others."""
    result = []
    for samples in delayed.by_sensor:
        spread = np.abs(delayed.slope(samples, places)) @ delayed.scale
        result += [float(spread.max() ** 2)] * samples.count
    return np.array(result)
