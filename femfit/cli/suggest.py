"""``femfit suggest``: the next measurement that separates what is still confounded."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from femfit.cli.table_options import NO_TABLE_OPTIONS, TableOptions
from femfit.core.errors import TableError


def suggest(
    model: Path,
    data: Path | None = None,
    *,
    plan: Path | None = None,
    table_options: Annotated[TableOptions, Parameter(name="*")] = NO_TABLE_OPTIONS,
    json: Path | None = None,
) -> None:
    """Advise the cheapest measurement that tells apart what the data leave together, or examine a plan.

    Parameters
    ----------
    model : Path
        Model file.
    data : Path
        Bench table, or record over time, that was diagnosed.
    plan : Path
        Planned bench table: settings, and a column (its cells may be empty) for each channel to be read. Says what such
        a campaign could never tell apart.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.output import status, write_json
    from femfit.core.outputs import RESULT, require_outputs
    from femfit.identify.decision.campaign import considered_effects
    from femfit.identify.decision.diagnose import diagnose
    from femfit.identify.experiments.plan import examine_plan
    from femfit.identify.experiments.suggest import suggest_measurements
    from femfit.identify.experiments.suggest_text import isolating_lines, plan_lines, suggestion_lines
    from femfit.model.json_file import read_model
    from femfit.tables.measurement import BenchTable
    from femfit.tables.measurement_file import read_bench_table, read_measurement

    require_outputs([model, data, plan], (json, RESULT))
    actuator = read_model(model)
    if plan is not None and data is None:
        report = examine_plan(
            actuator, read_bench_table(plan, planned=True, **table_options.keywords), considered_effects()
        )
        write_json(json, report.to_dict())
        print("\n".join(plan_lines(report)))
        return
    if data is None or plan is not None:
        raise TableError("Give either a bench table that was measured, or a planned one with --plan PLAN.csv.")
    measured = read_measurement(data, **table_options.keywords)
    with status("Diagnosing") as say:
        diagnosis = diagnose(actuator, measured, bootstrap=0, progress=say)
        explanations = diagnosis.explanations
        advice = []
        if isinstance(measured, BenchTable) and diagnosis.campaign is not None and len(explanations) > 1:
            say("Trying measurements")
            noise = diagnosis.campaign.noise
            advice = suggest_measurements(actuator, measured, noise, explanations, considered_effects())
    names = [" + ".join(fit.names) for fit in explanations]
    write_json(json, {"explanations": names, "suggestions": [one.to_dict() for one in advice]})
    if names:
        print(f"The data leave: {'; '.join(names)}.")
    if diagnosis.campaign is None:
        print(diagnosis.findings[-1])
    elif isinstance(measured, BenchTable):
        print("\n".join(suggestion_lines(advice, len(explanations))))
    else:
        print("\n".join(isolating_lines(explanations)))
