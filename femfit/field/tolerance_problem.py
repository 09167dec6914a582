"""A group of distances on the level of settings that meets a tolerance, and the error that is left there."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.field.settings import SolverSettings
from femfit.field.superposition import DISAGREEMENT

if TYPE_CHECKING:
    from ngsolve import Mesh

    from femfit.field.point_field import PointField


ROUNDING = 1e-10
"""Of the largest value at a distance: below it, a value is 0."""


class LevelProblem(Protocol):
    """What one level solves."""

    mesh: "Mesh"

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""

    def rows(self, distance: float, currents: tuple[float, ...]) -> dict[str, list[Any]]:
        """Columns of the sweep table at a distance."""

    def field(self, distance: float, current: float) -> "PointField":
        """The field at a point."""


@dataclass(frozen=True)
class LevelChoice:
    """The outcome of a search: all that a worker needs to solve the group's distances as the one who searched does.

    Parameters
    ----------
    force_errors : tuple of float
        Of the force at these currents, relative to :func:`scale`, the safety factor included.
    """

    level: int
    currents_A: tuple[float, ...]
    force_errors: tuple[float, ...]

    def as_json(self) -> dict[str, Any]:
        """By field name."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "LevelChoice":
        """From :meth:`as_json`, read again or not."""
        return cls(content["level"], tuple(content["currents_A"]), tuple(content["force_errors"]))


class ToleranceProblem:
    """A group of distances on the level that meets the tolerance."""

    def __init__(self, problem: LevelProblem, settings: SolverSettings, choice: LevelChoice) -> None:
        self._problem = problem
        self.settings = settings
        self.choice = choice
        self._currents: FloatArray = np.array(choice.currents_A)
        self._errors: FloatArray = np.array(choice.force_errors)

    @property
    def mesh(self) -> "Mesh":
        """Of the level."""
        return self._problem.mesh

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self._problem.unknowns

    def rows(self, distance: float, currents: tuple[float, ...]) -> dict[str, list[Any]]:
        """Columns of the sweep table at a distance.

        Returns
        -------
        dict of list
            By column name, one value a current.
        """
        columns = self._problem.rows(distance, currents)
        if "force_N" in columns:
            error = self._relative(np.array(currents)) * scale(columns["force_N"], currents)
            columns["force_error_N"] = np.maximum(error, columns[DISAGREEMENT]).tolist()
        return columns

    def field(self, distance: float, current: float) -> "PointField":
        """The field at a point, with the mesh left stretched to it."""
        return self._problem.field(distance, current)

    def _relative(self, currents: FloatArray) -> FloatArray:
        """The larger error of the two checked currents on either side."""
        last = len(self._currents) - 1
        above = np.clip(np.searchsorted(self._currents, currents), 0, last)
        below = np.clip(np.searchsorted(self._currents, currents, side="right") - 1, 0, last)
        return np.maximum(self._errors[above], self._errors[below])


def scale(values: Sequence[float], currents: Sequence[float]) -> FloatArray:
    """What errors at one distance are relative to: a value, or that at the weakest current if it is larger.

    Where the coil's force cancels the magnet's, the sum is no measure of what was computed. A force that vanishes by
    symmetry leaves the solver's last digits, which are no measure of anything.

    Returns
    -------
    array, shape (currents,)
        In the values' unit; 0 for what vanishes.
    """
    size = np.abs(np.array(values, dtype=np.float64))
    size = np.fmax(size, size[int(np.argmin(np.abs(currents)))])
    return np.asarray(np.where(size <= ROUNDING * np.fmax.reduce(size), 0.0, size))
