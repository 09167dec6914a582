"""Where the controller's state comes from: a Kalman filter, or the direct measurement.

The direct observer is what the paper compares its filter with: distance by inverting the Hall characteristic, velocity
by differentiating it (raw, or through a first-order filter), current from the coil's own L i' = U - R i + k_m v, which
is kinder than the static U/R of (15) because the paper's coil takes 6 ms.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14) to (16) and Figure 14.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.filters.direct import HallInverse
from femfit.filters.filter import Filter
from femfit.filters.filter_state import FilterState
from femfit.model.actuator_model import ActuatorModel

Memory = TypeVar("Memory")


class Observer(ABC, Generic[Memory]):
    """Makes (distance, velocity, current) of readings and voltages; its memory is passed in and out."""

    @abstractmethod
    def start(self, estimate: FloatArray) -> Memory:
        """Memory before the first reading, from a first belief of shape (runs, 3)."""

    @abstractmethod
    def observe(self, memory: Memory, voltage: FloatArray, reading: FloatArray, *, first: bool) -> Memory:
        """Take one reading.

        Parameters
        ----------
        voltage : array, shape (runs,)
            Held since the sample before, in V.
        reading : array, shape (runs,)
            Hall voltage in V.
        """

    @abstractmethod
    def estimate(self, memory: Memory) -> FloatArray:
        """Distance in m, velocity in m/s, current in A, shape (runs, 3)."""

    @abstractmethod
    def diverged(self, memory: Memory) -> BoolArray:
        """Which runs' estimate is no longer to be trusted, shape (runs,)."""

    @abstractmethod
    def normalised_innovation_squared(self, memory: Memory) -> FloatArray:
        """Of the last reading, shape (runs,); NaN where there is no innovation."""


@dataclass(frozen=True, eq=False)
class FilterObserver(Observer[FilterState]):
    """A Kalman filter whose measurement is the Hall voltage.

    Parameters
    ----------
    filter : Filter
        With the states distance, velocity, current, possibly those of effects, and possibly Hall bias.
    """

    filter: Filter

    def start(self, estimate: FloatArray) -> FilterState:
        """Bias and the states of effects zero at the start."""
        return self.filter.start(estimate)

    def observe(self, memory: FilterState, voltage: FloatArray, reading: FloatArray, *, first: bool) -> FilterState:
        """Predict and update; only update at the first sample."""
        return self.filter.update(memory, reading) if first else self.filter.step(memory, voltage, reading)

    def estimate(self, memory: FilterState) -> FloatArray:
        """The first three states."""
        return memory.mean[:, :3]

    def diverged(self, memory: FilterState) -> BoolArray:
        """As the filter says."""
        return memory.diverged

    def normalised_innovation_squared(self, memory: FilterState) -> FloatArray:
        """As the filter says."""
        return memory.normalised_innovation_squared


@dataclass(frozen=True, eq=False)
class DirectObserver(Observer[FloatArray]):
    """The direct measurement.

    Parameters
    ----------
    velocity_cutoff_rad_s : float
        Of the first-order filter on the differentiated distance; infinite: the raw difference quotient.
    """

    model: ActuatorModel
    inverse: HallInverse
    velocity_cutoff_rad_s: float = np.inf

    def start(self, estimate: FloatArray) -> FloatArray:
        """Memory is the estimate itself, shape (runs, 3)."""
        return np.array(estimate)

    def observe(self, memory: FloatArray, voltage: FloatArray, reading: FloatArray, *, first: bool) -> FloatArray:
        """Coil equation, inversion, difference quotient."""
        distance, velocity, current = memory.T
        if first:
            return np.stack([self.inverse.distance(reading, current)[0], velocity, current], axis=1)
        step, circuit = self.model.sample_time_s, self.model.require_circuit()
        magnetic = self.model.magnetics.state(distance, current)
        decay = np.exp(-circuit.resistance_ohm / magnetic.inductance * step)
        rest = (voltage + magnetic.motional_constant * velocity) / circuit.resistance_ohm
        current = rest + decay * (current - rest)
        measured, _ = self.inverse.distance(reading, current)
        quotient = (measured - distance) / step
        kept = np.exp(-self.velocity_cutoff_rad_s * step)
        return np.stack([measured, kept * velocity + (1.0 - kept) * quotient, current], axis=1)

    def estimate(self, memory: FloatArray) -> FloatArray:
        """The memory."""
        return memory

    def diverged(self, memory: FloatArray) -> BoolArray:
        """Never: it has no belief that could."""
        return np.zeros(len(memory), dtype=bool)

    def normalised_innovation_squared(self, memory: FloatArray) -> FloatArray:
        """NaN."""
        return np.full(len(memory), np.nan)


@dataclass(frozen=True, eq=False)
class SplitObserver(Observer[tuple[Any, ...]]):
    """Different observers for different runs of one batch.

    Parameters
    ----------
    parts : tuple of (array of int, Observer)
        Indices of the runs and their observer; every run once.
    """

    parts: tuple[tuple[IntArray, Observer[Any]], ...]

    def start(self, estimate: FloatArray) -> tuple[Any, ...]:
        """One memory a part."""
        return tuple(observer.start(estimate[rows]) for rows, observer in self.parts)

    def observe(
        self, memory: tuple[Any, ...], voltage: FloatArray, reading: FloatArray, *, first: bool
    ) -> tuple[Any, ...]:
        """Each part on its own runs."""
        return tuple(
            observer.observe(own, voltage[rows], reading[rows], first=first)
            for (rows, observer), own in zip(self.parts, memory, strict=True)
        )

    def estimate(self, memory: tuple[Any, ...]) -> FloatArray:
        """Gathered from the parts."""
        return self._gathered([observer.estimate(own) for (_, observer), own in zip(self.parts, memory, strict=True)])

    def diverged(self, memory: tuple[Any, ...]) -> BoolArray:
        """Gathered from the parts."""
        values = [observer.diverged(own) for (_, observer), own in zip(self.parts, memory, strict=True)]
        return self._gathered(values).astype(bool)

    def normalised_innovation_squared(self, memory: tuple[Any, ...]) -> FloatArray:
        """Gathered from the parts."""
        return self._gathered(
            [observer.normalised_innovation_squared(own) for (_, observer), own in zip(self.parts, memory, strict=True)]
        )

    def _gathered(self, values: list[Any]) -> FloatArray:
        result = np.empty((sum(len(rows) for rows, _ in self.parts), *values[0].shape[1:]))
        for (rows, _), value in zip(self.parts, values, strict=True):
            result[rows] = value
        return result
