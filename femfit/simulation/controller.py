"""What every controller is: a pure step from an estimate and a reference to a voltage."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Reference:
    """The reference at one sample, or at all of them.

    Parameters
    ----------
    distance, velocity, acceleration : array
        In m, m/s and m/s^2; shape (runs,) or scalar at one sample, (steps,) or (steps, runs) for all.
    current : array or None
        That holds a body which moves so, in A and of the same shape; worked out by the controller where None.
    """

    distance: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    current: FloatArray | None = None

    def at(self, k: int | IntArray) -> "Reference":
        """The reference at sample k, or of some runs at one sample."""
        current = None if self.current is None else self.current[k]
        return Reference(self.distance[k], self.velocity[k], self.acceleration[k], current)


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

        Returns
        -------
        voltage : array, shape (runs,)
            Within the driver's clamp, in V.
        memory : array, shape (runs, words)
            For the next sample.
        """


@dataclass(frozen=True, eq=False)
class SplitController(Controller):
    """Different controllers for different runs of one batch.

    Parameters
    ----------
    parts : tuple of (array of int, Controller)
        Indices of the runs and their controller; every run once.
    """

    parts: tuple[tuple[IntArray, Controller], ...]

    def initial_memory(self, estimate: FloatArray) -> FloatArray:
        """Memories of all runs, padded to the longest."""
        memories = [(rows, controller.initial_memory(estimate[rows])) for rows, controller in self.parts]
        result = np.zeros((len(estimate), max(memory.shape[1] for _, memory in memories)))
        for rows, memory in memories:
            result[rows, : memory.shape[1]] = memory
        return result

    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """Each part's command on its own runs."""
        runs = len(estimate)
        voltage, updated = np.empty(runs), memory.copy()
        for rows, controller in self.parts:
            part = reference if np.ndim(reference.distance) == 0 else reference.at(rows)
            voltage[rows], words = controller.command(memory[rows], estimate[rows], part)
            updated[rows, : words.shape[1]] = words
        return voltage, updated
