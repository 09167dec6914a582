"""The sweep: every distance of every variant solved, in parallel, with a journal that a kill cannot spoil."""

import hashlib
import json
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from femfit.actuator.parts import Actuator
from femfit.actuator.variants import VariantSweep, only
from femfit.core.errors import FemfitError, FieldSolverError, RunDirectoryError
from femfit.core.journal import Journal, JournalHeader
from femfit.core.sweep_table import SweepTable, write_sweep_table
from femfit.fem.layout import Layout, layout_of, stretch_groups
from femfit.fem.settings import SolverSettings, settings_for
from femfit.fem.sweep_cluster import solve_on_cluster, versions
from femfit.fem.sweep_pool import AGAIN, solve_in_processes
from femfit.fem.sweep_rows import sweep_manifest, sweep_rows

if TYPE_CHECKING:
    from femfit.fem.problem import FieldProblem

Progress = Callable[[int, int], None]

_ONE_AT_A_TIME = threading.Lock()
"""A cluster's worker may have several threads, but a mesh has one state: it is stretched to one distance."""


@dataclass(frozen=True)
class DistanceTask:
    """One distance of a sweep: what a worker needs, picklable.

    Parameters
    ----------
    actuator : Actuator
        Checked.
    layout : Layout
        Of the whole sweep.
    settings : SolverSettings
        Order and element sizes.
    group : tuple of float
        Distances that share a mesh.
    distance : float
        In m.
    variant : int
        Number of the variant, from 1.
    """

    actuator: Actuator
    layout: Layout
    settings: SolverSettings
    group: tuple[float, ...]
    distance: float
    variant: int = 1

    @property
    def key(self) -> str:
        """Name in the journal."""
        return f"{self.variant}: {self.distance!r}"


def run_sweep(
    sweep: Actuator | VariantSweep,
    directory: Path,
    *,
    workers: int = 2,
    scheduler: str | None = None,
    settings: SolverSettings | None = None,
    progress: Progress | None = None,
) -> SweepTable:
    """Solve an actuator's sweep, or what a journal says is left of it, and write the table.

    Parameters
    ----------
    sweep : Actuator or VariantSweep
        Checked; with its variants, if parameters are swept.
    directory : Path
        For journal, table and manifest; made if absent.
    workers : int
        Processes; 1 solves in this one.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers solve instead.
    settings : SolverSettings, optional
        Order and element sizes; the defaults with the actuator's tolerance otherwise.
    progress : callable, optional
        Called with (rows done, rows in all).

    Returns
    -------
    SweepTable
        Rows ordered by variant, current, distance. Rows that could not be solved have their reason in ``status``.

    Raises
    ------
    RunDirectoryError
        If the directory holds another configuration's journal, is in use, or the disk is full at the end.
    FieldSolverError
        If not even a plan of the meshes can be made for any variant.
    ClusterError
        If the scheduler cannot be used or is lost.
    """
    sweep = only(sweep) if isinstance(sweep, Actuator) else sweep
    settings = settings or settings_for(sweep.actuator)
    tasks, failed = _plan(sweep, settings)
    configuration = _configuration(sweep, settings)
    currents = len(sweep.variants[0].sweep.currents_A)

    def report() -> None:
        if progress is not None:
            progress(len(journal.finished) * currents, len(tasks) * currents)

    def done(task: DistanceTask, result: Mapping[str, Any]) -> None:
        journal.record(task.key, result)
        report()

    with Journal(directory, JournalHeader(configuration["hash"])) as journal:
        report()
        left = [task for task in tasks if journal.finished.get(task.key, {AGAIN: True}).get(AGAIN)]
        _solve_all(left, workers, scheduler, done)
        solved = {(task.variant, task.distance): journal.finished[task.key] for task in tasks}
        table = SweepTable(
            sweep_rows(sweep, solved | failed), sweep_manifest(sweep, configuration) | _beyond_curve(solved)
        )
        _write(table, directory, journal)
    return table


def plan_sweep(actuator: Actuator, settings: SolverSettings, variant: int = 1) -> list[DistanceTask]:
    """The tasks of an actuator's sweep, in order of distance.

    Parameters
    ----------
    actuator : Actuator
        Checked.
    settings : SolverSettings
        Order and element sizes.
    variant : int
        Number of the variant.

    Returns
    -------
    list of DistanceTask
        One a distance.
    """
    layout = layout_of(actuator, settings)
    groups = stretch_groups(actuator.sweep.distances_m, layout, settings)
    return [
        DistanceTask(actuator, layout, settings, group, distance, variant) for group in groups for distance in group
    ]


def solve_task(task: DistanceTask) -> dict[str, Any]:
    """Solve one distance; a mesh or solution that fails becomes a result with its reason.

    Parameters
    ----------
    task : DistanceTask
        Any.

    Returns
    -------
    dict
        JSON-ready: ``status`` and, when it is ok, ``rows``: the table's columns, one value a current; ``again`` where
        the memory was too small, not the drawing at fault.
    """
    try:
        with _ONE_AT_A_TIME:
            rows = _problem(task).rows(task.distance, task.actuator.sweep.currents_A)
            return {"status": "ok", "rows": rows}
    except _failures() as error:
        _prepared.cache_clear()  # what was interrupted half-way must not serve the next distance
        return _failure(error)


def _problem(task: DistanceTask) -> "FieldProblem":
    """On the group's mesh, or on one of the distance's own where that cannot be made."""
    try:
        return _prepared(task.actuator, task.group, task.layout, task.settings)
    except FieldSolverError:
        if len(task.group) == 1:
            raise
        return _prepared(task.actuator, (task.distance,), task.layout, task.settings)


@lru_cache(maxsize=1)
def _prepared(actuator: Actuator, group: tuple[float, ...], layout: Layout, settings: SolverSettings) -> "FieldProblem":
    """The mesh of a group, kept while a worker's tasks stay in it."""
    from ngsolve import SetNumThreads  # noqa: PLC0415  the field solver loads in the workers only

    from femfit.fem.problem import prepare  # noqa: PLC0415

    SetNumThreads(1)  # the rows are the parallel axis; threads inside a factorisation halve its speed
    return prepare(actuator, group, layout, settings)


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


def _plan(
    sweep: VariantSweep, settings: SolverSettings
) -> tuple[list[DistanceTask], dict[tuple[int, float], dict[str, Any]]]:
    """The tasks of all variants; and the results of those for which there is nothing to solve."""
    tasks: list[DistanceTask] = []
    failed: dict[tuple[int, float], dict[str, Any]] = {}
    for number, variant in enumerate(sweep.variants, 1):
        problem = variant.problem
        if variant.actuator is not None:
            try:
                tasks += plan_sweep(variant.actuator, settings, number)
                continue
            except FieldSolverError as error:
                problem = str(error)
        failed |= {(number, distance): {"status": f"failed: {problem}"} for distance in variant.sweep.distances_m}
    if not tasks:
        raise FieldSolverError(next(iter(failed.values()))["status"].removeprefix("failed: "))
    return tasks, failed


def _solve_all(
    tasks: Sequence[DistanceTask],
    workers: int,
    scheduler: str | None,
    done: Callable[[DistanceTask, dict[str, Any]], None],
) -> None:
    if scheduler is not None and tasks:
        solve_on_cluster(tasks, solve_task, done, scheduler)
    elif workers == 1 or len(tasks) < 2:
        for task in tasks:
            done(task, solve_task(task))
    else:
        solve_in_processes(tasks, solve_task, done, workers)


def _write(table: SweepTable, directory: Path, journal: Journal) -> None:
    """Write the table; on a full disk say what is kept."""
    try:
        write_sweep_table(table, directory)
    except OSError as error:
        raise RunDirectoryError(
            f"The table could not be written to {directory}: {error.strerror or error}. {journal.on_disk} of "
            f"{len(journal.finished)} results are in the journal. Make room, and give the same command again: it "
            "solves what is missing and writes the table."
        ) from error


def _beyond_curve(solved: Mapping[tuple[int, float], Mapping[str, Any]]) -> dict[str, int]:
    """How many points needed a B-H curve beyond its end; nothing for actuators that do not saturate."""
    flags = [
        result["rows"]["beyond_bh_curve"] for result in solved.values() if "beyond_bh_curve" in result.get("rows", {})
    ]
    return {"points_beyond_bh_curve": sum(map(sum, flags))} if flags else {}


def _configuration(sweep: VariantSweep, settings: SolverSettings) -> dict[str, Any]:
    content = {
        "actuator": asdict(sweep.actuator),
        "variants": [asdict(variant) for variant in sweep.variants],
        "settings": asdict(settings),
        "versions": versions(),
    }
    text = json.dumps(content, sort_keys=True)
    return {**content, "hash": hashlib.sha256(text.encode()).hexdigest()}
