"""``femfit trial``: how often the diagnosis would be right on an actuator of one's own."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators


def trial(
    *,
    drawing: Annotated[tuple[Path, ...], Parameter(negative=())],
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    cases: Annotated[int, Parameter(validator=validators.Number(gte=1))] = 60,
    seed: int = 1,
    workers: Annotated[int, Parameter(validator=validators.Number(gte=1))] = 2,
    json: Path | None = None,
) -> None:
    """How often would the diagnosis be right on this actuator? Hide effects in simulated campaigns, and count.

    The truths are other physics than femfit's effects: field solutions of changed drawings, relays, heat. What is
    hidden stands in a key that is opened after the diagnosis; its hash stands in the manifest before. Each campaign is
    diagnosed as femfit diagnose would, from its files.

    Parameters
    ----------
    drawing : tuple of Path
        Actuator file; repeat for more.
    output : Path
        Directory for cases, keys, answers and results; field solutions in it are used again.
    cases : int
        How many campaigns; 60 take some minutes.
    seed : int
        Of the cases.
    workers : int
        Processes.
    json : Path
        File for the results as JSON; results.json in the directory by default.
    """
    from femfit.cli.output import write_json
    from femfit.cli.progress import progress
    from femfit.core.outputs import RESULT, TABLE, require_outputs
    from femfit.trial.counts import trial_data, trial_lines
    from femfit.trial.run import TrialOptions, make_trial, run_trial, write_cases_csv

    require_outputs(list(drawing), (output / "cases.csv", TABLE), (json or output / "results.json", RESULT))
    options = TrialOptions(cases=cases, seed=seed, workers=workers)
    with progress("solve and measure", "campaigns") as show:
        commitments = make_trial(drawing, output, options, show)
    with progress("diagnose", "campaigns") as show:
        judgements = run_trial(output, commitments, options, show)
    write_cases_csv(judgements, output / "cases.csv")
    write_json(json or output / "results.json", trial_data(judgements))
    print("\n".join(trial_lines(judgements)))
    print(f"written: {output / 'cases.csv'}, one line a campaign")
