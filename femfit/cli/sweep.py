"""``femfit sweep``: an actuator file to a sweep table."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, validators


def sweep(
    actuator: Path,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    workers: Annotated[int | None, Parameter(validator=validators.Number(gte=1))] = None,
    scheduler: str | None = None,
    signatures: bool = False,
    json: Path | None = None,
) -> None:
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
    json : Path
        File for a summary as JSON.
    """
    from time import perf_counter

    from femfit.cli.output import sweep_progress, write_json
    from femfit.core.errors import FieldSolverError
    from femfit.core.files import RESULT, require_outputs
    from femfit.core.results import listing
    from femfit.core.text import counted
    from femfit.device.rewrite import read_variants
    from femfit.device.summary import remarks
    from femfit.field.sweep import run_sweep
    from femfit.field.sweep_rows import clipped_hall, failed_points, summarise, variants_without_a_point
    from femfit.tables.impedance_table import NAME as IMPEDANCE

    require_outputs([actuator], (json, RESULT))
    variants = read_variants(actuator)
    name = variants.actuator.name
    directory = output or Path("runs") / name
    start = perf_counter()
    with sweep_progress(name) as progress:
        table = run_sweep(
            actuator,
            directory,
            workers=workers or len(os.sched_getaffinity(0)),
            scheduler=scheduler,
            signatures=signatures,
            progress=progress,
        )
    summary = summarise(table) | {"seconds": perf_counter() - start, "directory": str(directory)}
    write_json(json, summary)
    points = counted(summary["rows"], "point")
    points += f" of {counted(len(variants.variants), 'variant')}" if variants.columns else ""
    print(f"{directory}: {points}, {summary['failed']} failed, in {summary['seconds']:.1f} s{_force(summary)}")
    for remark in (*remarks(variants.actuator), *clipped_hall(variants, table)):
        print(f"  {remark}")
    if variants.columns and variants.actuator.frequencies_Hz:
        print("  Eddy currents were not solved: a sweep of parameters is at rest. Sweep one variant alone for them.")
    if table.eddy is not None:
        print(f"  {table.eddy}; what an ampere does at each frequency: {directory / IMPEDANCE}")
    if table.still_mm:
        places = ", ".join(f"{distance:g}" for distance in table.still_mm)
        print(f"  Eddy currents could not be solved at {places} mm; a model takes them from the distances beside.")
    if table.signatures is not None:
        print("  By one standard deviation of each number of the drawing, root mean square over the sweep:")
        print("\n".join(f"    {line}" for line in str(table.signatures).splitlines()))
    for line in failed_points(table):
        print(f"  {line}")
    if beyond := summary.get("points_beyond_bh_curve"):
        lie = counted(beyond, "point lies", "points lie")
        print(f"  {lie} beyond the last point of a B-H curve: extrapolated")
    if beyond := summary.get("rows_beyond_tolerance"):
        miss = counted(beyond, "point does", "points do")
        print(f"  {miss} not meet the tolerance; force_error_N says by how much")
    if summary["failed"] == summary["rows"]:
        raise FieldSolverError(f"No point of {actuator} could be solved; the reasons are above and in the table.")
    if lost := variants_without_a_point(table):
        raise FieldSolverError(
            f"No point could be solved of {counted(len(lost), 'variant')} of {len(variants.variants)} "
            f"({listing(map(str, lost), 10)}); the reasons are above and in the table, which has the others. Correct "
            "those values of sweep.parameters, or leave them out."
        )


def _force(summary: Mapping[str, Any]) -> str:
    if summary["force_min_N"] is None:
        return ""
    from femfit.core.text import amount

    return (
        f"; force {summary['force_min_N']:.4g} to {summary['force_max_N']:.4g} N, its discretisation error estimated "
        f"at most {amount(summary['force_error_relative_max'], '')}"
    )
