"""``femfit sweep``: an actuator file to a sweep table."""

import os
from pathlib import Path
from typing import Annotated

import femfit as ff
from femfit.cli.command import AT_LEAST_ONE, OUTPUT, Outcome, Writes, command, run_directory
from femfit.cli.output import said, sweep_progress
from femfit.core.errors import FieldSolverError


@command("File for a summary as JSON.")
def sweep(
    actuator: Path,
    *,
    output: Annotated[Path | None, OUTPUT, Writes(default=run_directory("actuator"))] = None,
    workers: Annotated[int | None, AT_LEAST_ONE] = None,
    signatures: bool = False,
) -> Outcome:
    """Solve the field over an actuator's currents and distances.

    An interrupted sweep goes on where it stopped when the same command is given again.

    Parameters
    ----------
    actuator : Path
        Actuator file (.toml).
    output : Path
        Run directory; runs/NAME by default.
    workers : int
        Number of processes on this machine; one a core by default.
    signatures : bool
        Signatures of the drawing's numbers, solved too (about as long again at most), with which a diagnosis asks
        whether one of them is wrong; those in the directory stay without it.
    """
    from time import perf_counter

    from femfit.device.rewrite import read_variants
    from femfit.field.sweep_rows import failed_points, summarise, variants_without_a_point
    from femfit.tables.eddy_table import IMPEDANCES as IMPEDANCE

    assert output is not None  # noqa: S101 - the default of Writes
    variants = read_variants(actuator)
    start = perf_counter()
    with sweep_progress(variants.actuator.name) as progress:
        table = ff.run_sweep(
            actuator,
            output,
            workers=workers or len(os.sched_getaffinity(0)),
            signatures=signatures,
            progress=progress,
        )
    summary = summarise(table) | {"seconds": perf_counter() - start, "directory": str(output)}
    facts = (output, variants, table, summary, variants.remarks)
    lines = said("sweep", "lines", *facts, failed_points(table), IMPEDANCE)
    lost, error = variants_without_a_point(table), None
    if summary["failed"] == summary["rows"]:
        error = FieldSolverError(said("sweep", "no_point", actuator))
    elif lost:
        error = FieldSolverError(said("sweep", "lost_variants", lost, len(variants.variants)))
    return Outcome(lines, summary, error=error)
