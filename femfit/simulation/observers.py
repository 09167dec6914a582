"""Where the controller's state comes from: a Kalman filter, or the direct measurement.

An observer steps as :class:`femfit.filters.filter.Filter` does, and its state has the same three readings: ``mean``
(runs, 3 or more: distance, velocity, current), ``diverged`` and ``normalised_innovation_squared`` (runs,).
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.filters.direct import HallInverse
from femfit.filters.filter import Filter


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

    Distance by inverting the Hall characteristic, velocity by the difference quotient, current from the coil's own
    L i' = U - R i + k_m v, which is kinder than the static U/R of (15) because the paper's coil takes 6 ms.

    References
    ----------
    A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14) to (16) and Figure 14.
    """

    inverse: HallInverse

    def start(self, mean: FloatArray) -> Seen:
        """The belief itself."""
        return Seen(np.array(mean), np.zeros(len(mean), dtype=bool), np.full(len(mean), np.nan))

    def update(self, state: Seen, measurement: FloatArray) -> Seen:
        """The distance alone."""
        mean = state.mean.copy()
        mean[:, 0] = self.inverse.distance(measurement, mean[:, 2])[0]
        return Seen(mean, state.diverged, state.normalised_innovation_squared)

    def step(self, state: Seen, voltage: FloatArray, measurement: FloatArray) -> Seen:
        """Coil equation, inversion, difference quotient."""
        distance, velocity, current = state.mean.T
        model = self.inverse.model
        step, resistance = model.sample_time_s, model.require_circuit().resistance_ohm
        magnetic = model.magnetics.state(distance, current)
        decay = np.exp(-resistance / magnetic.inductance * step)
        rest = (voltage + magnetic.motional_constant * velocity) / resistance
        current = rest + decay * (current - rest)
        measured, _ = self.inverse.distance(measurement, current)
        mean = np.stack([measured, (measured - distance) / step, current], axis=1)
        return Seen(mean, state.diverged, state.normalised_innovation_squared)


@dataclass(frozen=True, eq=False)
class SplitObserver:
    """Different observers for different runs of one batch."""

    parts: tuple[tuple[IntArray, "Observer"], ...]  # Indices of the runs and their observer; every run once

    def start(self, mean: FloatArray) -> Seen:
        """Each part on its own runs."""
        return self._gathered([observer.start(mean[rows]) for rows, observer in self.parts])

    def update(self, state: Seen, measurement: FloatArray) -> Seen:
        """Each part on its own runs."""
        own = zip(self.parts, state.parts, strict=True)
        return self._gathered([observer.update(part, measurement[rows]) for (rows, observer), part in own])

    def step(self, state: Seen, voltage: FloatArray, measurement: FloatArray) -> Seen:
        """Each part on its own runs."""
        own = zip(self.parts, state.parts, strict=True)
        return self._gathered([observer.step(s, voltage[rows], measurement[rows]) for (rows, observer), s in own])

    def _gathered(self, states: list[Any]) -> Seen:
        runs = sum(len(rows) for rows, _ in self.parts)
        mean, diverged, quality = np.empty((3, runs)).T, np.empty(runs, dtype=bool), np.empty(runs)
        for (rows, _), state in zip(self.parts, states, strict=True):
            mean[rows], diverged[rows] = state.mean[:, :3], state.diverged
            quality[rows] = state.normalised_innovation_squared
        return Seen(mean, diverged, quality, tuple(states))


Observer: TypeAlias = Filter | DirectObserver | SplitObserver
