"""The tasks of a sweep, and the processes that solve them; one that kills its worker costs itself alone.

A task is a distance or, of the harmonic part, a probe or the forms of a distance.

A process that dies breaks its pool and every task in it, and the pool does not say whose fault it was. So few tasks are
handed out at a time, those that were out are solved again, each in a process of its own, and the rest goes to a new
pool.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from femfit.core.errors import FemfitError, FieldSolverError
from femfit.core.numerics import FloatArray
from femfit.core.processes import ProcessPool, kept_interrupts, process_pool
from femfit.core.results import json_ready
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.parts import Actuator
from femfit.field.layout import Layout, layout_of, stretch_groups
from femfit.field.point_rows import swept_currents
from femfit.field.tolerance import LevelChoice, SolverSettings, shares_checks

Task = TypeVar("Task")
Result = dict[str, Any]
Done = Callable[[Task, Result], None]
"""Takes a task and its result here, as they come."""

Solve = Callable[[Sequence[Any], Done[Any]], None]
"""Solves tasks, in any order."""

AGAIN = "again"
"""Mark of a result that the machine, not the task, is to blame for: the same command tries it again."""

DIED: Result = {"status": "failed: the worker process died (out of memory, or killed)", AGAIN: True}

SPARE = 1
"""Tasks handed out beyond the workers, so that none waits for its next one."""


@contextmanager
def solvers(workers: int) -> Iterator[Solve]:
    """Processes of this machine that solve one round of tasks after the other, so that each loads and meshes once.

    The result is :data:`DIED` where the task's own process died.
    """
    pools: list[ProcessPool] = []

    def solve(tasks: Sequence[Any], done: Done[Any]) -> None:
        waiting = deque(tasks)
        while waiting and workers == 1:
            done(waiting[0], solve_task(waiting.popleft()))
        while waiting:
            out: dict[Future[Result], Any] = {}
            if not pools:
                pools.append(process_pool(workers))
                for _ in range(workers):  # while the first task chooses a level
                    pools[0].submit(import_module, "femfit.field.problem")
            try:
                while waiting or out:
                    while waiting and len(out) < workers + SPARE:
                        out[pools[0].submit(solve_task, waiting[0])] = waiting[0]
                        waiting.popleft()
                    for future in wait(out, return_when=FIRST_COMPLETED).done:
                        result = future.result()
                        done(out.pop(future), result)
            except BrokenProcessPool:
                pools.pop().shutdown(wait=False, kill_workers=True)
                for task in out.values():
                    done(task, _alone(task))

    try:
        yield solve
    finally:  # nothing is left to do, or the user will not wait for it
        for pool in pools:
            pool.shutdown(wait=False, kill_workers=True)


def _alone(task: Any) -> Result:
    pool = process_pool(1)
    try:
        return dict(pool.submit(solve_task, task).result())
    except BrokenProcessPool:
        return DIED
    finally:
        pool.shutdown(wait=False, kill_workers=True)


if TYPE_CHECKING:
    from femfit.field.problem import MeshedActuator


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

    @property
    def shares_level(self) -> bool:
        """Whether one level is chosen for all of the distances, by the task of the first one."""
        return self.settings.tolerance is not None and shares_checks(self.distances)

    def of(self, distance: float) -> "MeshGroup":
        """The group of a distance alone, in m."""
        return replace(self, distances=(distance,), choice=None)


def mesh_groups(actuator: Actuator, settings: SolverSettings) -> dict[float, MeshGroup]:
    """What each distance of an actuator's sweep is solved on, in ascending order."""
    layout = layout_of(actuator, settings)
    groups = stretch_groups(actuator.sweep.distances_m, layout, settings)
    return {distance: MeshGroup(actuator, layout, settings, group) for group in groups for distance in group}


@dataclass(frozen=True)
class DistanceTask:
    """One distance of a sweep; its result has ``rows``, the table's columns, one value a point of the currents.

    The first one of a group that shares its level searches for it, so that not every worker does; its result has the
    ``choice``; where the group has no mesh it has none.
    """

    mesh: MeshGroup
    distance: float
    variant: int = 1
    numbers: tuple[DrawnNumber, ...] = ()  # Whose ``signatures`` the result has, too

    @property
    def key(self) -> str:
        """Name in the journal."""
        return f"{self.variant}: {self.distance!r}"

    @property
    def chooses(self) -> bool:
        """Whether it searches for its group's level."""
        return self.mesh.shares_level and self.distance == self.mesh.distances[0]

    def at_level(self, choice: Mapping[str, Any] | None) -> "DistanceTask":
        """The task on the level that was chosen, or on a mesh of its own where its group has none."""
        if choice is None:
            return replace(self, mesh=self.mesh.of(self.distance))
        return replace(self, mesh=replace(self.mesh, choice=LevelChoice(**choice)))

    def result(self) -> dict[str, Any]:
        """On the group's mesh, or on one of the distance's own where that cannot be made."""
        choice = None
        try:
            problem = problem_of(self.mesh)
            if self.chooses and problem.choice is not None:
                choice = asdict(problem.choice)
        except FieldSolverError:
            if len(self.mesh.distances) == 1:
                raise
            problem = problem_of(self.mesh.of(self.distance))
        currents = swept_currents(self.mesh.actuator.sweep)
        result = {"rows": json_ready(problem.rows(self.distance, currents))}  # a current without a field has null
        if choice is not None:
            result["choice"] = choice
        if self.numbers:
            slopes = problem.signatures(self.distance, currents, self.numbers)
            result["signatures"] = json_ready(slopes)
        return result


def solve_task(task: "DistanceTask | ProbeTask | FormsTask") -> dict[str, Any]:
    """Solve a task; a mesh or solution that fails becomes a result with its reason.

    Returns
    -------
    dict
        JSON-ready: ``status`` and, when it is ok, what the task gives; ``again`` where the memory was too small, not
        the drawing at fault.
    """
    try:
        with kept_interrupts():
            return {"status": "ok"} | task.result()
    except BaseException as error:
        MESHES.clear()  # what was interrupted half-way must not serve the next distance
        from netgen.libngpy._meshing import NgException  # noqa: PLC0415  loaded by now

        text = " ".join(str(error).split())
        if isinstance(error, FemfitError):
            return {"status": f"failed: {text}"}
        if not isinstance(error, NgException | RuntimeError | MemoryError | ArithmeticError):
            raise
        if isinstance(error, MemoryError) or "allocate" in text:
            remedy = "Give the same command with fewer workers, or more memory"
            return {"status": f"failed: out of memory ({text}). {remedy}", AGAIN: True}
        remedy = "Look for extreme dimensions or materials in the actuator file"
        return {"status": f"failed: the field solver stopped ({text}). {remedy}"}


MESHES: "dict[MeshGroup, MeshedActuator]" = {}
"""This process's mesh, one at most; a worker solves many distances on it."""


def problem_of(group: MeshGroup) -> "MeshedActuator":
    """A group's field problem, made where it is not the one that was asked for last."""
    if group not in MESHES:
        from ngsolve import SetNumThreads  # noqa: PLC0415  the field solver loads in the workers only

        from femfit.field.problem import prepare  # noqa: PLC0415

        SetNumThreads(1)  # the rows are the parallel axis; threads inside a factorisation halve its speed
        MESHES.clear()
        MESHES[group] = prepare(group.actuator, group.distances, group.layout, group.settings, group.choice)
    return MESHES[group]


@dataclass(frozen=True)
class Patterns:
    """Rows (q, points) of :class:`femfit.field.harmonic.ConductorPoints` of a mesh."""

    mesh: MeshGroup
    rows: FloatArray = field(compare=False)
    checksum: int  # Of the rows


@dataclass(frozen=True)
class ProbeTask:
    """Direct solutions at a distance; its result has ``transfers`` and ``braking``.

    Where asked for, ``coarse`` are the transfers one order lower; where it has ``shifts``, ``rows`` are induced
    currents at the reference mesh's points, with their ``weight`` and which ``material`` they flow in; where it has
    ``numbers``, ``slopes`` are what these change of the inductances.
    """

    mesh: MeshGroup
    reference: MeshGroup
    distance: float
    frequencies: tuple[float, ...]
    shifts: tuple[float, ...]
    coarse: bool
    numbers: tuple[DrawnNumber, ...] = ()
    bias: tuple[float, ...] = ()  # In A; where parts saturate

    def result(self) -> dict[str, Any]:
        """Solve; nothing of it is written to the journal."""
        from femfit.field import eddy_probe  # noqa: PLC0415  the field solver loads in the workers only
        from femfit.field.signature_rows import impedance_slopes  # noqa: PLC0415

        moving, order = eddy_probe.moving_mesh(self.mesh), self.mesh.settings.order
        actuator, frequencies = self.mesh.actuator, np.array(self.frequencies)
        probe = eddy_probe.EddyProbe(actuator, moving, self.distance, order, self.bias)
        transfers, fields = probe.transfers(frequencies)
        result: dict[str, Any] = {"transfers": transfers, "braking": probe.braking()}
        if self.coarse:
            coarser = eddy_probe.EddyProbe(actuator, moving, self.distance, order - 1, self.bias)
            result["coarse"] = coarser.transfers(frequencies)[0]
        if self.numbers:
            space, d = probe.points.space, self.distance
            result["slopes"] = impedance_slopes(actuator, self.numbers, moving, space, d, frequencies, fields)
        if not self.shifts:
            return result
        places = probe.points if self.reference == self.mesh else eddy_probe.conductor_points(self.reference)
        rows = probe.patterns(fields, np.array(self.shifts), places, actuator.eddy_error)
        return result | {"rows": rows, "weight": places.weight, "material": places.material_rows}


@dataclass(frozen=True)
class FormsTask:
    """The forms of all sources at a distance; its result has ``force``, ``flux_linkage`` and ``hall`` as lists."""

    mesh: MeshGroup
    distance: float
    patterns: Patterns
    bias: tuple[float, ...] = ()  # In A; where parts saturate

    @property
    def key(self) -> str:
        """Name in the journal."""
        return f"eddy currents {self.patterns.checksum:08x} {self.distance!r}"

    def result(self) -> dict[str, Any]:
        """Solve on the group's mesh."""
        from femfit.field import eddy_probe  # noqa: PLC0415  the field solver loads in the workers only

        system = eddy_probe.system_with_patterns(self.mesh, self.patterns)
        system.bias = np.array(self.bias)
        with eddy_probe.moving_mesh(self.mesh).at(self.distance):
            forms = system.evaluate()
        arrays = {name: getattr(forms, name) for name in ("force", "flux_linkage", "hall", "rest")}
        return {name: None if array is None else array.tolist() for name, array in arrays.items()}
