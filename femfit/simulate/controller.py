"""What every controller is: a pure step from an estimate and a reference to a voltage."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Reference:
    """The reference at one sample, or at all of them.

    Parameters
    ----------
    distance, velocity, acceleration : array
        In m, m/s and m/s^2; shape (runs,) or scalar at one sample, (steps,) or (steps, runs) for all.
    """

    distance: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    def at(self, k: int) -> "Reference":
        """The reference at sample k."""
        return Reference(self.distance[k], self.velocity[k], self.acceleration[k])


class Controller(ABC):
    """A controller; frozen, its memory is passed in and out."""

    @abstractmethod
    def initial_memory(self, estimate: FloatArray) -> FloatArray:
        """Memory of a loop that starts at rest.

        Parameters
        ----------
        estimate : array, shape (runs, 3)
            Distance in m, velocity in m/s, current in A.

        Returns
        -------
        array, shape (runs, words)
            Possibly of no words.
        """

    @abstractmethod
    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """The voltage of the next sample period.

        Parameters
        ----------
        memory : array, shape (runs, words)
            From the sample before.
        estimate : array, shape (runs, 3)
            Distance in m, velocity in m/s, current in A.
        reference : Reference
            At this sample.

        Returns
        -------
        voltage : array, shape (runs,)
            Within the driver's clamp, in V.
        memory : array, shape (runs, words)
            For the next sample.
        """


@dataclass(frozen=True, eq=False)
class SplitController(Controller):
    """Different controllers for consecutive runs of one batch.

    Parameters
    ----------
    parts : tuple of (int, Controller)
        Number of runs and their controller.
    """

    parts: tuple[tuple[int, Controller], ...]

    def _slices(self) -> list[tuple[slice, Controller]]:
        ends = np.cumsum([runs for runs, _ in self.parts])
        return [(slice(int(end) - runs, int(end)), c) for end, (runs, c) in zip(ends, self.parts, strict=True)]

    def initial_memory(self, estimate: FloatArray) -> FloatArray:
        """Memories side by side, padded to the longest."""
        memories = [controller.initial_memory(estimate[rows]) for rows, controller in self._slices()]
        words = max(memory.shape[1] for memory in memories)
        return np.concatenate([np.pad(memory, ((0, 0), (0, words - memory.shape[1]))) for memory in memories])

    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """Each part's command on its own runs."""
        runs = len(estimate)
        wanted = (reference.distance, reference.velocity, reference.acceleration)
        r, v, a = (np.broadcast_to(value, (runs,)) for value in wanted)
        voltage, updated = np.empty(runs), memory.copy()
        for rows, controller in self._slices():
            words = controller.initial_memory(estimate[rows]).shape[1]
            part = Reference(r[rows], v[rows], a[rows])
            voltage[rows], updated[rows, :words] = controller.command(memory[rows, :words], estimate[rows], part)
        return voltage, updated
