"""The tasks of a sweep, as workers solve them: the level of a group of distances, and each distance."""

import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

from femfit.core.errors import FemfitError, FieldSolverError
from femfit.core.files import json_ready
from femfit.core.interrupts import held_interrupts, kept_interrupts
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.parts import Actuator
from femfit.field.currents import swept_currents
from femfit.field.layout import Layout
from femfit.field.sweep_workers import AGAIN
from femfit.field.tolerance import LevelChoice, SolverSettings, ToleranceProblem

if TYPE_CHECKING:
    from femfit.field.problem import FieldProblem

_ONE_AT_A_TIME = threading.Lock()
"""A cluster's worker may have several threads, but a mesh has one state: it is stretched to one distance."""


FINER = 0.8
"""Numerical: share of the elements' size of a mesh that is to be another one at about the same cost."""


@dataclass(frozen=True)
class MeshGroup:
    """What a mesh is made from; picklable."""

    actuator: Actuator
    layout: Layout
    settings: SolverSettings
    distances: tuple[float, ...]  # Distances that share the mesh, m, ascending
    # The level that meets the tolerance, where it is known. It follows from all others, so that it does not tell
    # groups apart: whoever chose the level goes on with its mesh.
    choice: LevelChoice | None = field(default=None, compare=False)

    def of(self, distance: float) -> "MeshGroup":
        """The group of a distance alone, in m."""
        return replace(self, distances=(distance,), choice=None)

    def finer(self, distance: float) -> "MeshGroup":
        """That with a mesh of smaller elements."""
        settings = self.settings
        corners, regions = FINER * settings.corner_fraction, FINER * settings.region_fraction
        return replace(self.of(distance), settings=replace(settings, corner_fraction=corners, region_fraction=regions))


@dataclass(frozen=True)
class DistanceTask:
    """One distance of a sweep; its result has ``rows``, the table's columns, one value a point of the currents."""

    mesh: MeshGroup
    distance: float
    variant: int = 1
    numbers: tuple[DrawnNumber, ...] = ()  # Whose ``signatures`` the result has, too

    @property
    def key(self) -> str:
        """Name in the journal."""
        return f"{self.variant}: {self.distance!r}"

    def result(self) -> dict[str, Any]:
        """On the group's mesh, or on one of the distance's own where that cannot be made."""
        try:
            problem = MESHES.problem(self.mesh)
        except FieldSolverError:
            if len(self.mesh.distances) == 1:
                raise
            problem = MESHES.problem(self.mesh.of(self.distance))
        currents = swept_currents(self.mesh.actuator.sweep)
        rows = problem.rows(self.distance, currents)
        if failed := _failed(rows):  # which may be for a mesh that is badly shaped here
            with suppress(FieldSolverError):
                finer = MESHES.problem(self.mesh.finer(self.distance))
                again = finer.rows(self.distance, currents)
                if _failed(again) < failed:
                    problem, rows = finer, again
        result = {"rows": json_ready(rows)}  # a current without a field has null
        if not self.numbers:
            return result
        slopes = problem.signatures(self.distance, currents, self.numbers)
        return result | {"signatures": json_ready(slopes.tolist())}


@dataclass(frozen=True)
class LevelTask:
    """The level on which a group meets its tolerance; its result has ``choice``, None where the group has no mesh.

    Each worker would else check each group for itself, which takes longer than to solve a short one.
    """

    mesh: MeshGroup
    variant: int = 1

    @property
    def key(self) -> str:
        """Name in the journal."""
        return f"{self.variant}: level from {self.mesh.distances[0]!r}"

    def result(self) -> dict[str, Any]:
        """Refine; the mesh is kept for the group's distances."""
        try:
            problem = MESHES.problem(self.mesh)
        except FieldSolverError:
            return {"choice": None}
        return {"choice": asdict(problem.choice) if isinstance(problem, ToleranceProblem) else None}

    def distances(self, tasks: Sequence[DistanceTask], result: dict[str, Any]) -> list[DistanceTask]:
        """The group's distances, as the result says that they are to be solved."""
        if result["choice"] is None:
            return [replace(task, mesh=self.mesh.of(task.distance)) for task in tasks]
        mesh = replace(self.mesh, choice=LevelChoice.from_json(result["choice"]))
        return [replace(task, mesh=mesh) for task in tasks]


def _failed(rows: Mapping[str, Sequence[Any]]) -> int:
    """How many points have no field; a linear actuator's rows, of one solution, have no status."""
    return sum(status != "ok" for status in rows.get("status", ()))


SweepTask = DistanceTask | LevelTask
"""What a worker solves; picklable."""


def solve_task(task: SweepTask) -> dict[str, Any]:
    """Solve a task; a mesh or solution that fails becomes a result with its reason.

    Returns
    -------
    dict
        JSON-ready: ``status`` and, when it is ok, what the task gives; ``again`` where the memory was too small, not
        the drawing at fault.
    """
    try:
        with _ONE_AT_A_TIME, kept_interrupts():
            return {"status": "ok"} | task.result()
    except BaseException as error:
        MESHES.clear()  # what was interrupted half-way must not serve the next distance
        if not isinstance(error, _failures()):
            raise
        return _failure(error)


class MeshCache:
    """The mesh of one group, kept while a worker's tasks stay in it."""

    def __init__(self) -> None:
        self._group: MeshGroup | None = None
        self._problem: FieldProblem | None = None

    def problem(self, group: MeshGroup) -> "FieldProblem":
        """The group's field problem, made where it is not the one that was asked for last."""
        if self._problem is None or group != self._group:
            with held_interrupts():  # NGSolve prints a stack where a signal hits its import
                from ngsolve import SetNumThreads  # noqa: PLC0415  the field solver loads in the workers only

                from femfit.field.problem import prepare  # noqa: PLC0415

            SetNumThreads(1)  # the rows are the parallel axis; threads inside a factorisation halve its speed
            self.clear()
            self._problem = prepare(group.actuator, group.distances, group.layout, group.settings, group.choice)
            self._group = group
        return self._problem

    def clear(self) -> None:
        """Forget the mesh, as in a new process."""
        self._group = self._problem = None


MESHES = MeshCache()
"""This process's mesh; a worker solves many distances on one."""


def _failures() -> tuple[type[Exception], ...]:
    """What meshing and solving raise when a drawing or the memory is beyond them."""
    from netgen.libngpy._meshing import NgException  # noqa: PLC0415  loaded by now

    return (NgException, RuntimeError, MemoryError, ArithmeticError)


def _failure(error: Exception) -> dict[str, Any]:
    text = " ".join(str(error).split())
    if isinstance(error, FemfitError):
        return {"status": f"failed: {text}"}
    if isinstance(error, MemoryError) or "allocate" in text:
        return {
            "status": f"failed: out of memory ({text}). Give the same command with fewer workers, or more memory",
            AGAIN: True,
        }
    return {
        "status": f"failed: the field solver stopped ({text}). Look for extreme dimensions or materials in the "
        "actuator file"
    }
