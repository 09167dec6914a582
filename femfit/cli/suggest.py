"""``femfit suggest``: the next measurement that separates what is still confounded."""

from pathlib import Path

import femfit as ff
from femfit.cli.command import MeasurementOptions, Outcome, command
from femfit.core.errors import UsageError


@command()
def suggest(
    model: Path,
    data: Path | None = None,
    *,
    plan: Path | None = None,
    table_options: MeasurementOptions,
) -> Outcome:
    """The next measurement that separates what is still confounded.

    Parameters
    ----------
    model : Path
        Model file.
    data : Path
        Bench table, or record over time, that was diagnosed.
    plan : Path
        Planned bench table with settings and a column (its cells may be empty) for each channel to be read, examined
        for what it could never separate.
    """
    from femfit.cli.output import status
    from femfit.identify.plan import examine_plan
    from femfit.tables.measurement_file import read_bench_table

    if (data is None) == (plan is None):
        raise UsageError("Give either a bench table that was measured, or a planned one with --plan PLAN.csv.")
    with status("Diagnosing") as say:
        if plan is not None:
            planned = read_bench_table(plan, planned=True, **table_options)
            return Outcome(examine_plan(ff.read_model(model), planned))
        assert data is not None  # noqa: S101 - one of the two is given
        return Outcome(ff.suggest(model, ff.read_measurement(data, **table_options), progress=say))
