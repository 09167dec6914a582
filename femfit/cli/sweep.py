"""``femfit sweep``: an actuator file to a sweep table."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from femfit.cli.command import OUTPUT, Outcome, Writes, command, run_directory
from femfit.cli.options import AT_LEAST_ONE
from femfit.core.errors import FieldSolverError
from femfit.core.results import listing
from femfit.core.text import amount, counted

if TYPE_CHECKING:
    from femfit.device.rewrite import VariantSweep
    from femfit.tables.sweep_table import SweepTable


@command("File for a summary as JSON.")
def sweep(
    actuator: Path,
    *,
    output: Annotated[Path | None, OUTPUT, Writes(default=run_directory("actuator"))] = None,
    workers: Annotated[int | None, AT_LEAST_ONE] = None,
    scheduler: str | None = None,
    signatures: bool = False,
) -> Outcome:
    """Solve the field over the actuator's currents, distances and parameters, and write the table.

    An interrupted sweep goes on where it stopped when the same command is given again.

    Parameters
    ----------
    actuator : Path
        Actuator file (.toml).
    output : Path
        Run directory; runs/NAME by default.
    workers : int
        Number of processes on this machine; one a core by default.
    scheduler : str
        Address of a Dask scheduler (tcp://host:port) whose workers solve instead; a worker that hangs is waited for
        until you end it.
    signatures : bool
        Signatures of the drawing's numbers, solved too (about as long again at most), with which a diagnosis asks
        whether one of them is wrong; those in the directory stay without it.
    """
    from time import perf_counter

    from femfit.cli.output import sweep_progress
    from femfit.device.rewrite import read_variants
    from femfit.field.sweep import run_sweep
    from femfit.field.sweep_rows import summarise

    assert output is not None  # noqa: S101 - the default of Writes
    variants = read_variants(actuator)
    start = perf_counter()
    with sweep_progress(variants.actuator.name) as progress:
        table = run_sweep(
            actuator,
            output,
            workers=workers or len(os.sched_getaffinity(0)),
            scheduler=scheduler,
            signatures=signatures,
            progress=progress,
        )
    summary = summarise(table) | {"seconds": perf_counter() - start, "directory": str(output)}
    lines = list(_lines(output, variants, table, summary))
    return Outcome("\n".join(lines), summary, error=_unsolved(actuator, variants, table, summary))


def _lines(directory: Path, variants: "VariantSweep", table: "SweepTable", summary: Mapping[str, Any]) -> Iterator[str]:
    """What is said of a sweep."""
    from femfit.device.summary import remarks
    from femfit.field.sweep_rows import clipped_hall, failed_points
    from femfit.tables.impedance_table import NAME as IMPEDANCE

    points = counted(summary["rows"], "point")
    points += f" of {counted(len(variants.variants), 'variant')}" if variants.columns else ""
    yield f"{directory}: {points}, {summary['failed']} failed, in {summary['seconds']:.1f} s{_force(summary)}"
    yield from (f"  {remark}" for remark in (*remarks(variants.actuator), *clipped_hall(variants, table)))
    if variants.columns and variants.actuator.frequencies_Hz:
        yield "  Eddy currents were not solved: a sweep of parameters is at rest. Sweep one variant alone for them."
    if table.eddy is not None:
        yield f"  {table.eddy}; what an ampere does at each frequency: {directory / IMPEDANCE}"
    if table.still_mm:
        places = ", ".join(f"{distance:g}" for distance in table.still_mm)
        yield f"  Eddy currents could not be solved at {places} mm; a model takes them from the distances beside."
    if table.signatures is not None:
        yield "  By one standard deviation of each number of the drawing, root mean square over the sweep:"
        yield from (f"    {line}" for line in str(table.signatures).splitlines())
    yield from (f"  {line}" for line in failed_points(table))
    if beyond := summary.get("points_beyond_bh_curve"):
        lie = counted(beyond, "point lies", "points lie")
        yield f"  {lie} beyond the last point of a B-H curve: extrapolated"
    if beyond := summary.get("rows_beyond_tolerance"):
        miss = counted(beyond, "point does", "points do")
        yield f"  {miss} not meet the tolerance; force_error_N says by how much"


def _unsolved(
    actuator: Path, variants: "VariantSweep", table: "SweepTable", summary: Mapping[str, Any]
) -> FieldSolverError | None:
    """The error of a sweep, or of a variant, without a point that could be solved."""
    from femfit.field.sweep_rows import variants_without_a_point

    if summary["failed"] == summary["rows"]:
        return FieldSolverError(f"No point of {actuator} could be solved; the reasons are above and in the table.")
    if lost := variants_without_a_point(table):
        return FieldSolverError(
            f"No point could be solved of {counted(len(lost), 'variant')} of {len(variants.variants)} "
            f"({listing(map(str, lost), 10)}); the reasons are above and in the table, which has the others. Correct "
            "those values of sweep.parameters, or leave them out."
        )
    return None


def _force(summary: Mapping[str, Any]) -> str:
    if summary["force_min_N"] is None:
        return ""
    return (
        f"; force {summary['force_min_N']:.4g} to {summary['force_max_N']:.4g} N, its discretisation error estimated "
        f"at most {amount(summary['force_error_relative_max'], '')}"
    )
