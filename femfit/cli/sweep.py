"""``femfit sweep``: an actuator file to a sweep table."""

import os
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators


def sweep(
    actuator: Path,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    workers: Annotated[int | None, Parameter(validator=validators.Number(gte=1))] = None,
    json: Path | None = None,
) -> None:
    """Solve the field over the actuator's currents and distances, and write the table.

    An interrupted sweep goes on where it stopped when the same command is given again.

    Parameters
    ----------
    actuator : Path
        Actuator file (.toml).
    output : Path
        Run directory; runs/NAME by default.
    workers : int
        Processes; one a core by default.
    json : Path
        File for a summary as JSON.
    """
    from time import perf_counter

    from femfit.actuator.load import read_actuator
    from femfit.cli.output import progress_bar, write_json
    from femfit.fem.sweep import run_sweep
    from femfit.fem.sweep_summary import summarise

    parts = read_actuator(actuator)
    directory = output or Path("runs") / parts.name
    start = perf_counter()
    with progress_bar(f"sweep {parts.name}") as progress:
        table = run_sweep(parts, directory, workers=workers or len(os.sched_getaffinity(0)), progress=progress)
    summary = summarise(table) | {"seconds": perf_counter() - start, "directory": str(directory)}
    print(
        f"{directory}: {summary['rows']} points, {summary['failed']} failed, in {summary['seconds']:.1f} s; force "
        f"{summary['force_min_N']:.4g} to {summary['force_max_N']:.4g} N, its discretisation error estimated at most "
        f"{100 * summary['force_error_relative_max']:.3f} %"
    )
    for reason, count in summary["failures"].items():
        print(f"  {count} points {reason}")
    write_json(json, summary)
