"""``femfit trial``: how often the diagnosis would be right on an actuator of one's own."""

from functools import partial
from pathlib import Path
from typing import Annotated

from femfit.cli.command import AT_LEAST_ONE, OUTPUT, Outcome, Writes, command
from femfit.core.files import RESULT, write_json


@command()
def trial(
    *,
    drawing: Path,
    output: Annotated[Path, OUTPUT, Writes(RESULT, "results.json")],
    cases: Annotated[int, AT_LEAST_ONE] = 60,
    seed: int = 1,
    workers: Annotated[int, AT_LEAST_ONE] = 2,
) -> Outcome:
    """How often the diagnosis is right, on campaigns with a hidden effect.

    Hidden are numbers of the drawing that are off (remanence, turns, saturating iron), of which the field is solved
    again, and errors of the bench (stage, meters, resistance, temperatures), which act by their definition. Each
    campaign is diagnosed from its files as femfit diagnose would.

    Parameters
    ----------
    drawing : Path
        Actuator file.
    output : Path
        Directory for campaigns, what was hidden in them, diagnoses and results.json; field solutions in it are used
        again.
    cases : int
        Number of campaigns; 60 take some minutes.
    seed : int
        Seed of the campaigns.
    workers : int
        Number of processes.
    """
    from femfit.cli.output import progress
    from femfit.core.text import counted
    from femfit.trial.campaigns import diagnose_campaigns, make_campaigns, prepare_device
    from femfit.trial.counts import trial_data, trial_lines

    with progress("solve the fields", "points") as show:
        device = prepare_device(
            drawing, output, workers=workers, progress=lambda done: show(done.points_done, done.points)
        )
    numbers = make_campaigns(device, output, cases, seed)
    with progress("diagnose", "campaigns") as show:
        outcomes = diagnose_campaigns(output, numbers, workers=workers, progress=show)
    lines = trial_lines(outcomes)
    if len(numbers) < cases:
        omitted = counted(cases - len(numbers), "campaign")
        lines = [*lines, f"left out: {omitted} of which the device cannot show what was to be hidden"]
    data, file = trial_data(outcomes), output / "results.json"
    return Outcome("\n".join(lines), data, [(file, partial(write_json, data=data))])
