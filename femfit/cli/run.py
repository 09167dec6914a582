"""``femfit run``: the whole main job in turn."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, TypeVar

import femfit as ff
from femfit.cli.command import OUTPUT, Cores, Default, Outcome, Writes, command, run_directory
from femfit.cli.output import sentence, sweep_progress
from femfit.core.errors import ActuatorFileError
from femfit.core.files import MODEL, PAGE
from femfit.core.processes import process_pool

if TYPE_CHECKING:
    from femfit.simulation.summary import ClosedLoopStudy

Result = TypeVar("Result")

_MODEL, _LAW, _PAGE = "model.json", "model_law.json", "report.html"
_RunDirectory = Annotated[
    Path, OUTPUT, Default(run_directory("actuator")), Writes(MODEL, _MODEL), Writes(MODEL, _LAW), Writes(PAGE, _PAGE)
]


@command("File for the results as JSON.")
def run(
    actuator: Path,
    *,
    output: _RunDirectory,
    workers: Cores,
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
    from femfit.device.rewrite import read_variants
    from femfit.field.sweep_rows import failed_points, summarise
    from femfit.heat.find_temperatures import temperatures_at_supply
    from femfit.model.several_magnetics import NETWORK
    from femfit.report.actuator_report import draw_figures
    from femfit.report.page import ReportContent
    from femfit.report.write import hashes, with_field
    from femfit.simulation.open_loop import motion_at_supply
    from femfit.targets.estimator import export_estimator

    drawing, seconds = read_variants(actuator), dict[str, float]()
    if len(drawing.variants) > 1 or drawing.columns:
        raise ActuatorFileError(str(actuator), [sentence("run", "several", len(drawing.variants))])
    parts = drawing.actuator
    model_file, law_file, page = output / _MODEL, output / _LAW, output / _PAGE
    step = partial(_step, seconds)
    for remark in drawing.remarks:
        print(remark)
    with step("sweep") as say:
        with sweep_progress(parts.name) as progress:
            table = ff.run_sweep(actuator, output, workers=workers, signatures=signatures, progress=progress)
        summary = summarise(table)
        say(sentence("run", "sweep", summary), *failed_points(table))
    with step("fit") as say:
        reference = _fit(table, "coenergy", model_file)
        say(sentence("run", "fit", reference), *reference.notes)
    with process_pool(1) as pool:
        loop = pool.submit(_close_loop, reference.model, seed, model_file)  # beside all that does without it
        with step("open loop") as say:
            motion = motion_at_supply(reference.model)
            say(sentence("run", "motion", motion, parts.circuits))
        with step("temperatures") as say:
            heat = temperatures_at_supply(parts)
            say(sentence("run", "heat", heat, parts.circuits))
        with step("rank laws") as say:
            ranked = reference if reference.circuits else _fit(table, "all", law_file)
            say(sentence("run", "laws", ranked, NETWORK))
        with step("export") as say:
            files, why = _or_why(partial(export_estimator, reference.model, output / "estimator"))
            say(sentence("run", "export", output / "estimator", files, why))
        with step("pictures") as say:
            content = with_field(ReportContent(reference.model, parts, table, ranked, motion=motion, heat=heat))
            content = replace(content, pictures=tuple(draw_figures(content).items()))
            say("of all but the loop")
        with step("close the loop") as say:
            study, no_study = loop.result()
            say(sentence("run", "loop", study, no_study))
    with step("report") as say:
        written = (file for file in (output / "sweep.parquet", model_file, law_file) if file.is_file())
        ff.write_report(replace(content, study=study, no_study=no_study, hashes=hashes(written)), page)
        say(f"{page}, {page.stat().st_size / 1e6:.1f} MB")
    return Outcome(
        f"{sum(seconds.values()):.1f} s in all",
        {
            "directory": str(output),
            "sweep": summary,
            "reference": reference,
            "laws": ranked,
            "open_loop": motion,
            "temperatures": heat,
            "closed_loop": study,
            "no_closed_loop": no_study,
            "seconds": seconds,
        },
    )


@contextmanager
def _step(seconds: dict[str, float], name: str) -> Iterator[Callable[..., None]]:
    """Time a step, and print the lines that it was given when it ends."""
    lines: list[str] = []
    start = perf_counter()
    yield lambda *texts: lines.extend(texts)
    seconds[name] = perf_counter() - start
    with suppress(BrokenPipeError):  # of a reader who has seen enough
        print(f"{name:<26}{seconds[name]:5.1f} s  {lines[0]}", *lines[1:], sep="\n", flush=True)


def _fit(table: ff.SweepTable, law: str, file: Path) -> ff.FitResult:
    result = ff.fit_model(table, law=law)
    ff.write_model(result.model, file)
    return result


def _or_why(work: Callable[[], Result]) -> tuple[Result | None, str]:
    """What work gives, or why it gives nothing: an actuator that cannot levitate is no failure of the run."""
    from femfit.core.errors import DomainError, FilterError, MissingPartError

    try:
        return work(), ""
    except (DomainError, FilterError, MissingPartError) as error:
        return None, str(error)


def _close_loop(model: ff.ActuatorModel, seed: int, file: Path) -> "tuple[ClosedLoopStudy | None, str]":
    """The study, or why there is none."""
    from femfit.device.electrics import PositionSensor
    from femfit.model.sensors import HALL, sensors_of
    from femfit.simulation.close_loop import closed_loop_study

    sensors = sensors_of(model)
    if sensors and HALL not in sensors and not any(isinstance(sensor, PositionSensor) for sensor in sensors.values()):
        return None, sentence("run", "no_distance", file, list(sensors))
    return _or_why(partial(closed_loop_study, model, seed))
