"""Where the controller's state comes from: a Kalman filter, or the direct measurement.

An observer steps as :class:`femfit.estimate.filter.Filter` does, and its state has the same three readings: ``mean``
(runs, 2 + n or more: distance, velocity, currents), ``diverged`` and ``normalised_innovation_squared`` (runs,).

The distance straight from the first sensor's reading, where it tells one.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from femfit.core.errors import FilterError
from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.device.electrics import PositionSensor
from femfit.estimate.direct import HallInverse, hall_inverse
from femfit.estimate.filter import Filter
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallSensor
from femfit.model.sensing import characteristic
from femfit.model.sensors import sensor_named


@dataclass(frozen=True, eq=False)
class PositionInverse:
    """Distance from a position sensor's reading, by interpolation; the current does not matter."""

    model: ActuatorModel
    sensor: PositionSensor

    def distance(self, reading: FloatArray, current: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Distances in m, and which readings lie beyond the characteristic within the validity domain."""
        box = self.model.validity
        ends = np.array([box.distance_min_m, box.distance_max_m])
        places = np.unique(np.concatenate([np.asarray(self.sensor.distances_m).clip(*ends), ends]))
        read = characteristic(self.sensor, places)
        order = np.argsort(read)
        reading = np.broadcast_to(reading, np.shape(current)[:-1])
        outside = ~((reading >= read.min()) & (reading <= read.max()))
        return np.interp(reading, read[order], places[order]), outside

    def reading(self, distance: FloatArray, current: FloatArray) -> FloatArray:  # noqa: ARG002  as of a Hall element
        """What it reads at a distance in m."""
        return characteristic(self.sensor, distance)


def distance_inverse(model: ActuatorModel, name: str) -> HallInverse | PositionInverse:
    """The inversion of a sensor of this name.

    Raises
    ------
    FilterError
        If it reads something that many distances give.
    """
    sensor = sensor_named(model, name)
    if isinstance(sensor, HallSensor):
        return hall_inverse(model)
    if isinstance(sensor, PositionSensor):
        return PositionInverse(model, sensor)
    raise FilterError(
        f"A distance must follow from the reading of one sensor for a loop without a filter; {name} reads "
        f"{sensor.kind}. Use a filter, which needs no inversion, or name a position or Hall sensor first."
    )


@dataclass(frozen=True, eq=False)
class Seen:
    """A state without a covariance, or the states of several observers brought together."""

    mean: FloatArray
    diverged: BoolArray
    normalised_innovation_squared: FloatArray
    parts: tuple[Any, ...] = ()


@dataclass(frozen=True, eq=False)
class DirectObserver:
    """The direct measurement, which the paper compares its filter with.

    Distance by inverting the first sensor's characteristic, velocity by the difference quotient, currents from the
    coils' own L i' = U - R i + k_m v, which is kinder than the static U/R of (15) because the paper's coil takes 6 ms.

    References
    ----------
    A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14) to (16) and Figure 14.
    """

    inverse: HallInverse | PositionInverse

    def start(self, mean: FloatArray) -> Seen:
        """The belief itself."""
        return Seen(np.array(mean), np.zeros(len(mean), dtype=bool), np.full(len(mean), np.nan))

    def update(self, state: Seen, measurement: FloatArray) -> Seen:
        """The distance alone, from readings of shape (runs, sensors)."""
        mean, first = state.mean.copy(), measurement[:, 0]
        distance = self.inverse.distance(first, self.inverse.model.currents_of(mean))[0]
        mean[:, 0] = np.where(np.isnan(first), mean[:, 0], distance)
        return Seen(mean, state.diverged, state.normalised_innovation_squared)

    def step(self, state: Seen, voltage: FloatArray, measurement: FloatArray) -> Seen:
        """Coil equations, inversion, difference quotient; a sample that is missing leaves distance and velocity."""
        mean, first = state.mean, measurement[:, 0]
        model = self.inverse.model
        n, step = len(model.circuits), model.sample_time_s
        currents = self._coil_currents(mean, voltage)
        measured, _ = self.inverse.distance(first, currents)
        moved = np.concatenate([np.stack([measured, (measured - mean[:, 0]) / step], axis=1), currents], axis=1)
        missing = np.isnan(first)
        moved[missing, :2] = mean[missing, :2]
        return Seen(moved[:, : 2 + n], state.diverged, state.normalised_innovation_squared)

    def _coil_currents(self, mean: FloatArray, command: FloatArray) -> FloatArray:
        """Currents (runs, n) one sample later as if nothing else conducted, of bodies that go on within the domain."""
        model, n = self._alone, command.shape[1]
        box, count, time = model.validity, model.sample_step.count, model.sample_time_s
        state = np.zeros((model.order, len(mean)))
        state[: 2 + n] = mean[:, : 2 + n].T
        state[0] = np.clip(state[0], box.distance_min_m, box.distance_max_m)
        state[1] = np.clip(state[1], (box.distance_min_m - state[0]) / time, (box.distance_max_m - state[0]) / time)
        step = model.sample_step.function(time / count, driven=True, free=False)
        for _ in range(count):
            state = step(state, command.T, np.zeros(0))[:-1]
        return state[2 : 2 + n].T

    @cached_property
    def _alone(self) -> ActuatorModel:
        return self.inverse.model.without_eddies


@dataclass(frozen=True, eq=False)
class SplitObserver:
    """Different observers for different runs of one batch."""

    parts: tuple[tuple[IntArray, "Observer"], ...]  # Indices of the runs and their observer; every run once
    states: int  # 2 + n, those that the controller asks for

    def start(self, mean: FloatArray) -> Seen:
        """Each part on its own runs."""
        return self._gathered([observer.start(mean[rows]) for rows, observer in self.parts])

    def update(self, state: Seen, measurement: FloatArray) -> Seen:
        """Each part on its own runs."""
        pairs = zip(self.parts, state.parts, strict=True)
        return self._gathered([observer.update(observed, measurement[rows]) for (rows, observer), observed in pairs])

    def step(self, state: Seen, voltage: FloatArray, measurement: FloatArray) -> Seen:
        """Each part on its own runs."""
        pairs = zip(self.parts, state.parts, strict=True)
        return self._gathered([observer.step(s, voltage[rows], measurement[rows]) for (rows, observer), s in pairs])

    def _gathered(self, states: list[Any]) -> Seen:
        runs = sum(len(rows) for rows, _ in self.parts)
        mean, diverged, quality = np.empty((self.states, runs)).T, np.empty(runs, dtype=bool), np.empty(runs)
        for (rows, _), state in zip(self.parts, states, strict=True):
            mean[rows], diverged[rows] = state.mean[:, : self.states], state.diverged
            quality[rows] = innovation_quality(state)
        return Seen(mean, diverged, quality, tuple(states))


def innovation_quality(state: Any) -> FloatArray:
    """Normalised innovations squared over the number of sensors that were read: 1 is expected."""
    ratio: FloatArray = state.normalised_innovation_squared
    variance = getattr(state, "innovation_variance", None)
    if variance is None or variance.ndim == 1:
        return ratio
    return np.asarray(ratio / np.maximum(np.isfinite(variance).sum(axis=1), 1))


Observer: TypeAlias = Filter | DirectObserver | SplitObserver
