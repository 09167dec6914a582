r"""Accuracy on demand: the coarsest rung of a ladder of settings that gives force and flux linkage to a tolerance.

From rung to rung the polynomial order grows by one and the elements at the corners shrink to a quarter. At the corners
of iron, where the solution behaves like distance^(2/3), force and flux err by size^(4/3): a factor of six a rung; away
from them by the order. Measured on eight actuators, errors fall by a factor of 5 to 10 a rung.

Distances that share a mesh are checked at the group's two ends and its middle, against the next rung: the difference is
the rung's own error but for a sixth. All of the group is then solved on the one rung, so that the discretisation, and
with it the error, changes smoothly with the distance. A distance with a mesh of its own is compared with the rung below
instead, which costs a third of the solution: the difference is five times the error.

References
----------
C. Schwab, p- and hp-Finite Element Methods, Oxford 1998, chapter 4: orders growing on meshes graded towards corners
converge exponentially.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from ngsolve import Mesh

from femfit.core.arrays import FloatArray
from femfit.fem.point_field import PointField
from femfit.fem.settings import SolverSettings

FIRST_ORDER = 4
"""Errors of lower orders scatter so much with distance that three checks do not bound them."""

CORNERS = (0.1, 0.03, 0.008, 0.002, 0.0005)
"""Sizes at the corners, as fractions of the part's smallest extent, from rung to rung."""

CHECK_SAFETY = 2.0
"""On the difference to the next rung: that rung's own error, and errors between the checked distances."""

OWN_MESH_LIMIT = 3
"""Groups of up to this many distances are not worth checks on the next rung."""

MOST_CHECKED = 4  # currents of a nonlinear actuator


class RungProblem(Protocol):
    """What one rung solves."""

    mesh: Mesh

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""

    def rows(self, distance: float, currents: tuple[float, ...]) -> dict[str, list[Any]]:
        """Columns of the sweep table at a distance."""

    def field(self, distance: float, current: float) -> PointField:
        """The field at a point."""


class ToleranceProblem:
    """A group of distances on the rung that meets the tolerance.

    Parameters
    ----------
    problem : RungProblem
        Of the rung.
    settings : SolverSettings
        Of the rung.
    currents : tuple of float
        Where the error was measured, in A, ascending.
    errors : array, shape (currents,)
        Of the force, relative to :func:`scale`, the safety factor included.
    """

    def __init__(
        self, problem: RungProblem, settings: SolverSettings, currents: tuple[float, ...], errors: FloatArray
    ) -> None:
        self._problem = problem
        self.settings = settings
        self._currents = np.array(currents)
        self._errors = errors

    @property
    def mesh(self) -> Mesh:
        """Of the rung."""
        return self._problem.mesh

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self._problem.unknowns

    def rows(self, distance: float, currents: tuple[float, ...]) -> dict[str, list[Any]]:
        """Columns of the sweep table at a distance.

        Parameters
        ----------
        distance : float
            In m; within the group.
        currents : tuple of float
            In A, ascending.

        Returns
        -------
        dict of list
            By column name, one value a current.
        """
        columns = self._problem.rows(distance, currents)
        if "force_N" in columns:
            error = self._relative(np.array(currents)) * scale(columns["force_N"], currents)
            columns["force_error_N"] = error.tolist()
        return columns

    def field(self, distance: float, current: float) -> PointField:
        """The field at a point, with the mesh left stretched to it.

        Parameters
        ----------
        distance, current : float
            In m and A.

        Returns
        -------
        PointField
            Of the rung.
        """
        return self._problem.field(distance, current)

    def _relative(self, currents: FloatArray) -> FloatArray:
        """The larger error of the two checked currents on either side."""
        last = len(self._currents) - 1
        above = np.clip(np.searchsorted(self._currents, currents), 0, last)
        below = np.clip(np.searchsorted(self._currents, currents, side="right") - 1, 0, last)
        return np.maximum(self._errors[above], self._errors[below])


def meet_tolerance(
    build: Callable[[SolverSettings], RungProblem],
    group: tuple[float, ...],
    currents: tuple[float, ...],
    settings: SolverSettings,
) -> ToleranceProblem:
    """Climb the ladder until the tolerance is met, or to its end.

    Parameters
    ----------
    build : callable
        Prepares the group on a rung.
    group : tuple of float
        Distances that share a mesh, in m, ascending.
    currents : tuple of float
        To check, in A, ascending.
    settings : SolverSettings
        With the tolerance; its domain and groups are kept.

    Returns
    -------
    ToleranceProblem
        Its rows say the error that is left, also where the last rung does not meet the tolerance.
    """
    shared = len(group) > OWN_MESH_LIMIT
    distances = (group[0], group[len(group) // 2], group[-1]) if shared else group
    factor = CHECK_SAFETY if shared else 1.0
    tolerance = float(settings.tolerance or 0.0)

    def solve(rung: SolverSettings) -> _Solved:
        problem = build(rung)
        return _Solved(problem, rung, [problem.rows(distance, currents) for distance in distances])

    first, *others = ladder(settings)
    above, met = solve(first), False
    for rung in others:
        if met:
            break
        below, above = above, solve(rung)
        force = factor * _difference("force_N", below, above, currents)
        flux = factor * _difference("flux_linkage_Wb", below, above, currents)
        met = max(force.max(), flux.max()) <= tolerance
    chosen = below if shared else above
    return ToleranceProblem(chosen.problem, chosen.settings, currents, force)


def ladder(settings: SolverSettings) -> list[SolverSettings]:
    """The rungs, the coarsest first.

    Parameters
    ----------
    settings : SolverSettings
        With the tolerance; its domain and groups are kept.

    Returns
    -------
    list of SolverSettings
        Without a tolerance.
    """
    return [
        replace(settings, order=FIRST_ORDER + k, corner_fraction=corner, tolerance=None)
        for k, corner in enumerate(CORNERS)
    ]


def scale(values: Sequence[float], currents: Sequence[float]) -> FloatArray:
    """What errors at one distance are relative to: a value, or that at the weakest current if it is larger.

    Where the coil's force cancels the magnet's, the sum is no measure of what was computed.

    Parameters
    ----------
    values : sequence of float
        Force or flux linkage at the currents.
    currents : sequence of float
        In A.

    Returns
    -------
    array, shape (currents,)
        In the values' unit.
    """
    size = np.abs(np.array(values, dtype=np.float64))
    return np.asarray(np.fmax(size, size[int(np.argmin(np.abs(currents)))]))


def check_currents(currents: tuple[float, ...]) -> tuple[float, ...]:
    """The currents that a nonlinear actuator is checked at: the ends, the weakest, and some between.

    Parameters
    ----------
    currents : tuple of float
        In A, ascending.

    Returns
    -------
    tuple of float
        Ascending.
    """
    spread = np.linspace(0, len(currents) - 1, MOST_CHECKED).round().astype(int)
    chosen = {*spread.tolist(), int(np.argmin(np.abs(currents)))}
    return tuple(currents[k] for k in sorted(chosen))


@dataclass(frozen=True)
class _Solved:
    problem: RungProblem
    settings: SolverSettings
    columns: list[dict[str, list[Any]]]


def _difference(name: str, first: _Solved, second: _Solved, currents: tuple[float, ...]) -> FloatArray:
    """The largest difference over the distances, relative to the scale, for each current; shape (currents,)."""
    worst = np.zeros(len(currents))
    for one, other in zip(first.columns, second.columns, strict=True):
        if name in one and name in other:  # a current that did not converge has NaN, which says nothing of the error
            change = np.abs(np.array(one[name]) - np.array(other[name]))
            size = scale(other[name], currents)
            worst = np.fmax(worst, np.divide(change, size, out=np.zeros(len(currents)), where=size > 0.0))
    return worst
