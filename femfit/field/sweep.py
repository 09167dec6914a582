"""The sweep: every distance of every variant solved, in parallel, with a journal that a kill cannot spoil."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from femfit import __version__
from femfit.core.errors import FieldSolverError, RunDirectoryError, UsageError
from femfit.core.files import path_of
from femfit.core.journal import Journal, JournalHeader, holds
from femfit.device.drawn_numbers import DrawnNumber, read_numbers
from femfit.device.parts import Actuator
from femfit.device.rewrite import VariantSweep, only, read_variants
from femfit.device.tolerances import KINDS
from femfit.field.eddy_sweep import PATTERNS_NAME, eddy_sweep, induces
from femfit.field.point_rows import bias_currents, current_points, swept_currents
from femfit.field.sweep_rows import signatures_of, sweep_manifest, sweep_rows
from femfit.field.sweep_task import AGAIN, DistanceTask, Done, Result, mesh_groups, solvers
from femfit.field.tolerance import SolverSettings, settings_for
from femfit.tables.eddy_table import impedance_rows, write_impedance
from femfit.tables.sweep_table import SweepTable, write_sweep_table


@dataclass(frozen=True)
class SweepProgress:
    """How far a sweep is; ``changed`` names what makes it begin anew where the directory holds another one."""

    points_done: int
    points: int
    changed: tuple[str, ...]


Progress = Callable[[SweepProgress], None]


def run_sweep(
    sweep: str | Path | Actuator | VariantSweep,
    directory: str | Path,
    *,
    workers: int = 2,
    settings: SolverSettings | None = None,
    signatures: bool | Sequence[DrawnNumber] = False,
    progress: Progress | None = None,
) -> SweepTable:
    """Solve an actuator's sweep, or what a journal says is left of it, and write the table.

    Parameters
    ----------
    sweep : str, Path, Actuator or VariantSweep
        Actuator file, or what was read from it.
    directory : str or Path
        For journal, table and manifest; made if absent. A sweep that was interrupted goes on there.
    workers : int
        Processes of this machine. The calling script needs no ``__main__`` guard.
    settings : SolverSettings, optional
        Order and element sizes; the defaults with the actuator's tolerance otherwise.
    signatures : bool or sequence of DrawnNumber
        Whether to solve what each number of the drawing changes, too, which takes about as long again at most; the
        sweep is then given as an actuator file, or its numbers are. Those that the directory has of the same file are
        kept without being asked for.
    progress : callable, optional
        Called with a :class:`SweepProgress` before the start and after each distance.

    Returns
    -------
    SweepTable
        Rows ordered by variant, current, distance. Rows that could not be solved have their reason in ``status``.

    Raises
    ------
    RunDirectoryError
        If the directory is in use, or the disk is full at the end.
    UsageError
        If signatures are asked for of what is no actuator file.
    FieldSolverError
        If not even a plan of the meshes can be made for any variant.

    Examples
    --------
    >>> import femfit as ff
    >>> table = ff.run_sweep("rig.toml", "runs/rig", workers=2)
    >>> len(table.rows), set(table.rows["status"])
    (50, {'ok'})
    """
    numbers = _numbers(sweep) if signatures is True else tuple(signatures or ())
    drawing = sweep
    sweep = only(sweep) if isinstance(sweep, Actuator) else sweep
    if not isinstance(sweep, VariantSweep):
        sweep = read_variants(path_of(sweep, "The actuator file of a sweep"))
    harmonic = not sweep.columns and induces(sweep.actuator)
    directory = path_of(directory, "The run directory")
    settings = settings or settings_for(sweep.actuator)
    tasks, failed = _plan(sweep, settings)
    if not numbers and isinstance(drawing, str | Path) and not sweep.columns:
        drawn = _numbers(drawing)
        numbers = drawn if holds(directory, _configuration(sweep, settings, drawn)["hash"]) else ()
    configuration = _configuration(sweep, settings, numbers)
    at_rest = tuple(number for number in numbers if KINDS[number.facts.kind].at_rest)
    tasks = [replace(task, numbers=at_rest) for task in tasks]
    currents = len(swept_currents(sweep.variants[0].sweep))
    names = {task.key for task in tasks}

    def report() -> None:
        if progress is not None:
            finished = len(names & journal.finished.keys())
            progress(SweepProgress(finished * currents, len(tasks) * currents, journal.changed))

    def record(task: DistanceTask, result: Result) -> None:
        journal.record(task.key, result)
        report()

    header = JournalHeader(configuration["hash"], configuration["parts"])
    with Journal(directory, header) as journal, solvers(workers) as solve:
        report()
        unfinished = [task for task in tasks if journal.finished.get(task.key, {AGAIN: True}).get(AGAIN)]
        solve([task for task in unfinished if task.chooses], record)
        others = [task for task in unfinished if not task.chooses]
        solve(_at_levels(others, journal, record), record)
        solved = {(task.variant, task.distance): journal.finished[task.key] for task in tasks}
        rows = sweep_rows(sweep, solved | failed)
        eddy, slopes = None, None
        if harmonic:
            patterns, biases = directory / PATTERNS_NAME, bias_currents(sweep.actuator, rows)
            eddy, slopes = eddy_sweep(sweep.actuator, journal, patterns, configuration["hash"], solve, numbers, biases)
        manifest = sweep_manifest(sweep, configuration)
        tables = [result.get("rows", {}) for result in solved.values()]
        beyond = [columns["beyond_bh_curve"] for columns in tables if "beyond_bh_curve" in columns]
        if beyond:  # the actuator saturates
            manifest |= {"points_beyond_bh_curve": sum(map(sum, beyond))}
        drawn_slopes = signatures_of(sweep, solved, at_rest) if at_rest else None
        table = SweepTable(rows, manifest, drawn_slopes, eddy, slopes)
        _write(table, sweep.actuator, directory, journal)
    return table


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
                meshes = mesh_groups(variant.actuator, settings)
                tasks += [DistanceTask(mesh, distance, number) for distance, mesh in meshes.items()]
                continue
            except FieldSolverError as error:
                problem = str(error)
        failed |= {(number, distance): {"status": f"failed: {problem}"} for distance in variant.sweep.distances_m}
    if not tasks:
        raise FieldSolverError(next(iter(failed.values()))["status"].removeprefix("failed: "))
    return tasks, failed


def _at_levels(tasks: Sequence[DistanceTask], journal: Journal, record: Done[DistanceTask]) -> list[DistanceTask]:
    """The tasks as the levels want them that their groups' first ones chose; those whose process died are done."""
    ready = []
    for task in tasks:
        if not task.mesh.shares_level:
            ready.append(task)
            continue
        first = journal.finished[replace(task, distance=task.mesh.distances[0]).key]
        if AGAIN in first:
            record(task, first)
        else:
            ready.append(task.at_level(first.get("choice")))
    return ready


def _write(table: SweepTable, actuator: Actuator, directory: Path, journal: Journal) -> None:
    """Write the tables; on a full disk say what is kept."""
    try:
        write_sweep_table(table, directory)
        circuits = actuator.circuits
        currents = current_points(swept_currents(actuator.sweep), len(circuits))
        windings = [circuit.resistance_ohm for circuit in circuits], [circuit.inductance_H for circuit in circuits]
        induced = table.eddy if circuits else None
        write_impedance(None if induced is None else impedance_rows(induced, currents, *windings), directory)
    except OSError as error:
        raise RunDirectoryError(
            f"The table could not be written to {directory}: {error.strerror or error}. {journal.on_disk} of "
            f"{len(journal.finished)} results are in the journal. Make room, and give the same command again: it "
            "solves what is missing and writes the table."
        ) from error


def _numbers(sweep: str | Path | Actuator | VariantSweep) -> tuple[DrawnNumber, ...]:
    if not isinstance(sweep, str | Path):
        raise UsageError(
            f"Signatures need the actuator file, whose numbers they are of; instead received {type(sweep).__name__}. "
            "Give its path."
        )
    return read_numbers(sweep, harmonic=True)


def _configuration(sweep: VariantSweep, settings: SolverSettings, numbers: Sequence[DrawnNumber]) -> dict[str, Any]:
    """What a sweep is of: its ``hash``, and those of its ``parts``, under the names that a user knows them by."""
    configuration = {"settings": asdict(settings), "versions": {"femfit": __version__, "ngsolve": version("ngsolve")}}
    parts = {
        "the drawing": _of_field([asdict(sweep.actuator), [asdict(variant) for variant in sweep.variants]]),
        "the solver's settings": configuration["settings"],
        "the programs' versions": configuration["versions"],
        "the signatures asked for": _of_field([number.facts.solved for number in numbers]),
    }
    return {**configuration, "parts": {name: _hash(content) for name, content in parts.items()}, "hash": _hash(parts)}


def _hash(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _of_field(data: Any) -> Any:
    """The same without temperatures and a number's tolerance, so that a field need not be solved again for these."""
    if isinstance(data, dict):
        return {key: _of_field(value) for key, value in data.items() if key not in {"thermal", "tolerance"}}
    return [_of_field(value) for value in data] if isinstance(data, list | tuple) else data
