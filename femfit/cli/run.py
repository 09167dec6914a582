"""``femfit run``: the whole main job in turn."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from femfit.cli.command import AT_LEAST_ONE, OUTPUT, Outcome, Writes, command, run_directory
from femfit.cli.output import said
from femfit.core.files import MODEL, PAGE

if TYPE_CHECKING:
    from femfit.device.parts import Actuator
    from femfit.fit.result import FitResult
    from femfit.heat.result import Temperatures
    from femfit.model.actuator_model import ActuatorModel
    from femfit.simulation.open_result import OpenLoop
    from femfit.simulation.study import ClosedLoopStudy
    from femfit.tables.sweep_table import SweepTable

STEP_WIDTH = 26  # of the steps' names on the terminal
NO_SENSOR = 'the drawing has no sensor that a filter could read. Add one, as [sensors.NAME] with kind = "position".'
NO_DISTANCE = (
    "no sensor of the drawing reads the distance, as a Hall element or one of kind position does, and a body that is "
    "switched needs no loop. femfit simulate {model} tries one with {sensors} alone."
)
NO_COIL = "the drawing has no coil, so that there is nothing to control."

_MODEL, _LAW, _PAGE = "model.json", "model_law.json", "report.html"
_RunDirectory = Annotated[
    Path | None, OUTPUT, Writes(MODEL, _MODEL, run_directory("actuator")), Writes(MODEL, _LAW), Writes(PAGE, _PAGE)
]


@command("File for the results as JSON.")
def run(
    actuator: Path,
    *,
    output: _RunDirectory = None,
    workers: Annotated[int | None, AT_LEAST_ONE] = None,
    seed: int = 1,
    signatures: bool = False,
) -> Outcome:
    """Sweep, fit, export, close the loop and report, in turn.

    An interrupted run goes on with the sweep where it stopped when the same command is given again.

    Parameters
    ----------
    actuator : Path
        Actuator file (.toml).
    output : Path
        Run directory; runs/NAME by default.
    workers : int
        Number of processes for the sweep; one a core by default.
    seed : int
        Seed of the noise in the closed loop.
    signatures : bool
        Signatures of the drawing's numbers, solved too, so that a diagnosis can ask for them; those in the directory
        stay without it.
    """
    from dataclasses import replace

    from femfit.core.processes import process_pool
    from femfit.device.summary import remarks
    from femfit.model.network_magnetics import NETWORK
    from femfit.report.actuator_report import draw_figures, render_report
    from femfit.report.page import ReportContent, write_page
    from femfit.report.write import hashes, with_field

    parts = _single_actuator(actuator)
    assert output is not None  # noqa: S101 - the default of Writes
    model_file, law_file, page = output / _MODEL, output / _LAW, output / _PAGE
    steps = _Steps()
    for line in remarks(parts):
        print(line)
    table, summary = _sweep(steps, actuator, parts, output, workers or len(os.sched_getaffinity(0)), signatures)
    with steps.timed("fit"):
        reference = _fit(table, "coenergy", model_file)
    steps.say(said("run", "fit", reference))
    for line in reference.notes:
        print(line)
    with process_pool(1) as pool:
        loop = pool.submit(_close_loop, reference.model, seed, model_file)  # beside the ranking: each takes a core
        motion, heat = _at_supply(steps, reference.model, parts)
        with steps.timed("first half of the report"):
            first = ReportContent(reference.model, parts, table, reference, motion=motion, heat=heat, unfinished=True)
            content = with_field(first, parts)
            drawn = draw_figures(content)
            write_page(render_report(content, drawn), page)
        steps.say(f"{page} can be read; the laws and the loop follow")
        with steps.timed("rank laws"):
            ranked = reference if reference.circuits else _fit(table, "all", law_file)
        steps.say(said("run", "laws", ranked, NETWORK))
        with steps.timed("export"):
            exported = _export(reference.model, output / "estimator")
        steps.say(exported)
        with steps.timed("close the loop"):
            study, no_study = loop.result()
    steps.say(said("run", "loop", study, no_study, no_study in {NO_SENSOR, NO_COIL}))
    with steps.timed("report"):
        content = replace(
            content,
            fit=ranked,
            study=study,
            no_study=no_study,
            unfinished=False,
            timings_s=tuple(steps.times.items()),
            hashes=hashes([file for file in (output / "sweep.parquet", model_file, law_file) if file.is_file()]),
        )
        write_page(render_report(content, draw_figures(content, drawn=drawn)), page)
    steps.say(f"{page}, {page.stat().st_size / 1e6:.1f} MB")
    data = {
        "directory": str(output),
        "sweep": summary,
        "reference": reference.to_dict(),
        "laws": ranked.to_dict(),
        "open_loop": motion.to_dict() if motion else None,
        "temperatures": heat.to_dict() if heat else None,
        "closed_loop": study.data() if study else None,
        "no_closed_loop": no_study,
        "seconds": steps.times,
    }
    return Outcome(f"{sum(steps.times.values()):.1f} s in all", data)


def _single_actuator(path: Path) -> "Actuator":
    """The file's actuator, refused before the sweep where the fit would refuse it after."""
    from femfit.core.errors import ActuatorFileError
    from femfit.device.rewrite import read_variants
    from femfit.fit.coenergy_choice import check_grid
    from femfit.fit.constants import FEWEST_CURRENTS

    sweep = read_variants(path)
    if len(sweep.variants) > 1 or sweep.columns:
        problem = (
            f"sweep.parameters make {len(sweep.variants)} variants, and a run is of one actuator. "
            "Give femfit sweep and then femfit fit with --where, or leave the parameters out."
        )
        raise ActuatorFileError(str(path), [problem])
    axes = sweep.actuator.sweep
    # Without a circuit the co-energy depends on the distance alone; that of several is a quadratic form.
    single = len(sweep.actuator.circuits) == 1
    check_grid(len(axes.currents_A) if single else FEWEST_CURRENTS, len(axes.distances_m))
    return sweep.actuator


class _Steps:
    """Times of the steps, and a line of output after each."""

    def __init__(self) -> None:
        self.times: dict[str, float] = {}

    @contextmanager
    def timed(self, name: str, *, shown: bool = True) -> Iterator[None]:
        """Time a step; one that does not tell by itself how far it is says now and then that it goes on."""
        from time import perf_counter

        from femfit.cli.output import status

        start = perf_counter()
        with status(name) if shown else nullcontext():
            yield
        self.times[name] = perf_counter() - start

    def say(self, text: str) -> None:
        name = list(self.times)[-1]
        print(f"{name:<{STEP_WIDTH}}{self.times[name]:5.1f} s  {text}", flush=True)


def _sweep(
    steps: _Steps, actuator: Path, parts: "Actuator", directory: Path, workers: int, signatures: bool
) -> "tuple[SweepTable, dict[str, Any]]":
    from femfit.cli.output import sweep_progress
    from femfit.device.rewrite import only
    from femfit.field.sweep import run_sweep
    from femfit.field.sweep_rows import clipped_hall, failed_points, summarise

    with steps.timed("sweep", shown=False), sweep_progress(parts.name) as progress:
        table = run_sweep(actuator, directory, workers=workers, signatures=signatures, progress=progress)
    summary = summarise(table)
    steps.say(said("run", "sweep", summary))
    for line in (*failed_points(table), *clipped_hall(only(parts), table)):
        print(line)
    return table, summary


def _at_supply(
    steps: _Steps, model: "ActuatorModel", parts: "Actuator"
) -> "tuple[OpenLoop | None, Temperatures | None]":
    """What the supply moves and warms."""
    from femfit.heat.find_temperatures import temperatures_at_supply
    from femfit.simulation.open_loop import motion_at_supply

    with steps.timed("open loop"):
        motion = motion_at_supply(model)
    steps.say(said("run", "motion", motion, parts.circuits, NO_COIL))
    with steps.timed("temperatures"):
        heat = temperatures_at_supply(parts, model)
    steps.say(said("run", "heat", heat, parts.circuits, NO_COIL))
    return motion, heat


def _fit(table: "SweepTable", law: str, file: Path) -> "FitResult":
    from femfit.fit.build import fit_model
    from femfit.model.json_file import write_model

    result = fit_model(table, law=law)
    write_model(result.model, file)
    return result


def _close_loop(model: "ActuatorModel", seed: int, file: Path) -> "tuple[ClosedLoopStudy | None, str]":
    """The study, or why there is none: an actuator that cannot levitate is no failure of the run."""
    from femfit.core.errors import DomainError, FilterError, MissingPartError
    from femfit.device.electrics import PositionSensor
    from femfit.model.sensors import HALL, sensors_of
    from femfit.simulation.study import closed_loop_study

    sensors = sensors_of(model)
    if not (model.has_winding and sensors):
        return None, NO_SENSOR if model.has_winding else NO_COIL
    if HALL not in sensors and not any(isinstance(sensor, PositionSensor) for sensor in sensors.values()):
        return None, NO_DISTANCE.format(model=file, sensors=" and ".join(sensors))
    try:
        return closed_loop_study(model, seed), ""
    except (DomainError, FilterError, MissingPartError) as error:
        return None, str(error)


def _export(model: "ActuatorModel", directory: Path) -> str:
    from femfit.core.errors import DomainError, FilterError, MissingPartError
    from femfit.model.sensors import sensors_of
    from femfit.targets.estimator import export_estimator

    if not model.has_winding:
        return f"none: {NO_COIL}"
    if not sensors_of(model):
        return f"none: {NO_SENSOR}"
    try:
        files = export_estimator(model, directory)
    except (DomainError, FilterError, MissingPartError) as error:
        return f"none: {error}"
    return f"{directory}, {len(files)} files that need Python alone"
