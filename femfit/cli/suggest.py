"""``femfit suggest``: the next measurement that separates what is still confounded."""

from pathlib import Path

from femfit.cli.command import NO_MEASUREMENT_OPTIONS, MeasurementOptions, Outcome, command
from femfit.core.errors import UsageError


@command()
def suggest(
    model: Path,
    data: Path | None = None,
    *,
    plan: Path | None = None,
    table_options: MeasurementOptions = NO_MEASUREMENT_OPTIONS,
) -> Outcome:
    """Advise the cheapest measurement that separates what the data leave together, or examine a plan.

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
    from femfit.identify.plan import PlanReport, examine_plan
    from femfit.identify.suggest import Advice
    from femfit.identify.suggest import suggest as advise
    from femfit.model.json_file import read_model
    from femfit.tables.measurement_file import read_bench_table

    if (data is None) == (plan is None):
        raise UsageError("Give either a bench table that was measured, or a planned one with --plan PLAN.csv.")
    actuator = read_model(model)
    result: Advice | PlanReport
    with status("Diagnosing") as say:
        if data is not None:
            result = advise(actuator, table_options.read(data), progress=say)
        elif plan is not None:
            planned = read_bench_table(plan, planned=True, **table_options.keywords)
            result = examine_plan(actuator, planned)
    return Outcome(result)
