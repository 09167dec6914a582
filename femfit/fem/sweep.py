"""The sweep: every distance solved, in parallel over processes, with a journal that a kill cannot spoil."""

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from femfit import __version__
from femfit.actuator.parts import Actuator
from femfit.actuator.summary import sweep_manifest_entry
from femfit.core.errors import FieldSolverError
from femfit.core.journal import Journal, JournalHeader
from femfit.core.sweep_table import COLUMNS, SweepTable, write_sweep_table
from femfit.fem.layout import Layout, layout_of, stretch_groups
from femfit.fem.settings import SolverSettings

if TYPE_CHECKING:
    import pandas as pd

    from femfit.fem.problem import FieldProblem

Progress = Callable[[int, int], None]
FIELD_COLUMNS = ("force_N", "flux_linkage_Wb", "inductance_H", "coenergy_J", "hall_T", "force_error_N")
ATTEMPTS = 2  # pools that may break before the remaining distances are tried one by one


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
    """

    actuator: Actuator
    layout: Layout
    settings: SolverSettings
    group: tuple[float, ...]
    distance: float

    @property
    def key(self) -> str:
        """Name in the journal."""
        return repr(self.distance)


def run_sweep(
    actuator: Actuator,
    directory: Path,
    *,
    workers: int = 2,
    settings: SolverSettings | None = None,
    progress: Progress | None = None,
) -> SweepTable:
    """Solve an actuator's sweep, or what a journal says is left of it, and write the table.

    Parameters
    ----------
    actuator : Actuator
        Checked.
    directory : Path
        For journal, table and manifest; made if absent.
    workers : int
        Processes; 1 solves in this one.
    settings : SolverSettings, optional
        Order and element sizes; the defaults otherwise.
    progress : callable, optional
        Called with (rows done, rows in all).

    Returns
    -------
    SweepTable
        Rows ordered by current, then distance.

    Raises
    ------
    RunDirectoryError
        If the directory holds another configuration's journal.
    """
    settings = settings or SolverSettings()
    tasks = plan_sweep(actuator, settings)
    configuration = _configuration(actuator, settings)
    report = _row_progress(progress, len(actuator.sweep.currents_A), len(tasks))
    with Journal(directory, JournalHeader(configuration["hash"])) as journal:
        report(len(journal.finished))
        left = [task for task in tasks if task.key not in journal.finished]
        _solve_all(left, workers, journal, report)
        results = {task.distance: journal.finished[task.key] for task in tasks}
    table = SweepTable(_rows(actuator, results), _manifest(actuator, configuration))
    write_sweep_table(table, directory)
    return table


def plan_sweep(actuator: Actuator, settings: SolverSettings) -> list[DistanceTask]:
    """The tasks of a sweep, in order of distance.

    Parameters
    ----------
    actuator : Actuator
        Checked.
    settings : SolverSettings
        Order and element sizes.

    Returns
    -------
    list of DistanceTask
        One a distance.
    """
    layout = layout_of(actuator, settings)
    groups = stretch_groups(actuator.sweep.distances_m, layout, settings)
    return [DistanceTask(actuator, layout, settings, group, distance) for group in groups for distance in group]


def solve_task(task: DistanceTask) -> dict[str, Any]:
    """Solve one distance; a mesh or solution that fails becomes a result with its reason.

    Parameters
    ----------
    task : DistanceTask
        Any.

    Returns
    -------
    dict
        JSON-ready: ``status`` and, when it is ok, ``rows``: the table's columns, one value a current.
    """
    try:
        problem = _prepared(task.actuator, task.group, task.layout, task.settings)
        return {"status": "ok", "rows": problem.rows(task.distance, task.actuator.sweep.currents_A)}
    except FieldSolverError as error:
        return {"status": f"failed: {error}"}


@lru_cache(maxsize=1)
def _prepared(actuator: Actuator, group: tuple[float, ...], layout: Layout, settings: SolverSettings) -> "FieldProblem":
    """The mesh of a group, kept while a worker's tasks stay in it."""
    from ngsolve import SetNumThreads  # noqa: PLC0415  the field solver loads in the workers only

    from femfit.fem.problem import prepare  # noqa: PLC0415

    SetNumThreads(1)  # the rows are the parallel axis; threads inside a factorisation halve its speed
    return prepare(actuator, group, layout, settings)


def _solve_all(tasks: list[DistanceTask], workers: int, journal: Journal, report: Callable[[int], None]) -> None:
    if workers == 1 or len(tasks) < 2:
        for task in tasks:
            journal.record(task.key, solve_task(task))
            report(len(journal.finished))
        return
    for _ in range(ATTEMPTS):
        left = [task for task in tasks if task.key not in journal.finished]
        if not left:
            return
        try:
            with _pool(min(workers, len(left))) as pool:
                _collect(pool, left, journal, report)
        except BrokenProcessPool:
            continue
    for task in (task for task in tasks if task.key not in journal.finished):
        _solve_alone(task, journal)
        report(len(journal.finished))


def _solve_alone(task: DistanceTask, journal: Journal) -> None:
    """Solve in a process of its own, so that one that dies costs its own row only."""
    try:
        with _pool(1) as pool:
            result = pool.submit(solve_task, task).result()
    except BrokenProcessPool:
        result = {"status": "failed: the worker process died (out of memory, or killed)"}
    journal.record(task.key, result)


def _collect(pool: Executor, tasks: list[DistanceTask], journal: Journal, report: Callable[[int], None]) -> None:
    futures = {pool.submit(solve_task, task): task for task in tasks}
    try:
        for future in as_completed(futures):
            journal.record(futures[future].key, future.result())
            report(len(journal.finished))
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise


def _pool(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(workers, mp_context=get_context("spawn"))


def _row_progress(progress: Progress | None, currents: int, distances: int) -> Callable[[int], None]:
    if progress is None:
        return lambda _done: None
    return partial(lambda call, done: call(done * currents, distances * currents), progress)


def _rows(actuator: Actuator, results: Mapping[float, Mapping[str, Any]]) -> "pd.DataFrame":
    import pandas as pd  # noqa: PLC0415  loads while the workers solve

    currents = np.array(actuator.sweep.currents_A)
    frames = [_distance_rows(currents, distance, result) for distance, result in results.items()]
    rows = pd.concat([pd.DataFrame(frame) for frame in frames], ignore_index=True)
    rows = rows.reindex(columns=[name for name in COLUMNS if name in rows])
    if rows["hall_T"].isna().all():
        rows = rows.drop(columns="hall_T")
    return rows.sort_values(["current_A", "distance_m"], kind="stable", ignore_index=True)


def _distance_rows(currents: np.ndarray[Any, Any], distance: float, result: Mapping[str, Any]) -> dict[str, Any]:
    nothing = np.full(len(currents), math.nan)
    return {
        "current_A": currents,
        "distance_m": np.full(len(currents), distance),
        **dict.fromkeys(FIELD_COLUMNS, nothing),
        "status": result["status"],
        **result.get("rows", {}),
    }


def _configuration(actuator: Actuator, settings: SolverSettings) -> dict[str, Any]:
    content = {
        "actuator": asdict(actuator),
        "settings": asdict(settings),
        "versions": {"femfit": __version__, "ngsolve": version("ngsolve")},
    }
    text = json.dumps(content, sort_keys=True)
    return {**content, "hash": hashlib.sha256(text.encode()).hexdigest()}


def _manifest(actuator: Actuator, configuration: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "kind": "sweep",
        "name": actuator.name,
        "actuator": sweep_manifest_entry(actuator),
        "settings": configuration["settings"],
        "versions": configuration["versions"],
        "configuration_hash": configuration["hash"],
    }
