"""``femfit trial``: how often the diagnosis is right on campaigns with a hidden effect."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter, validators

DRAWINGS = {"bench": ("emaws-rig", "plunger-solenoid", "biased-electromagnet"), "series": ("emaws-rig",)}


def trial(
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    cases: Annotated[int, Parameter(validator=validators.Number(gte=1))] = 300,
    seed: int = 1,
    workers: Annotated[int, Parameter(validator=validators.Number(gte=1))] = 2,
    drawing: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    kind: Literal["bench", "series"] = "bench",
    baselines: bool = True,
    json: Path | None = None,
) -> None:
    """Make campaigns with a hidden effect, diagnose them, and count how often the diagnosis is right.

    The truths are other physics than the effects: field solutions of changed drawings, relays, heat. What is hidden
    stands in a key that is opened after the diagnosis; its hash stands in the manifest before.

    Parameters
    ----------
    output : Path
        Directory for cases, keys, answers and results; field solutions in it are used again.
    cases : int
        How many.
    seed : int
        Of the cases.
    workers : int
        Processes.
    drawing : tuple of Path
        Actuator files, repeat for more; some of geometry/ by default.
    kind : str
        Static bench tables, or closed-loop records of a levitated body.
    baselines : bool
        Try the baselines on the same files; they need scikit-learn (pip install femfit[trial]).
    json : Path
        File for the results as JSON; results.json in the directory by default.
    """
    from femfit.cli.output import status, write_json
    from femfit.core.outputs import RESULT, TABLE, require_outputs
    from femfit.trial.run import TrialOptions, make_trial, run_trial, write_cases_csv
    from femfit.trial.table import by_effect, trial_table

    require_outputs([], (output / "cases.csv", TABLE), (json or output / "results.json", RESULT))
    drawings = drawing or tuple(Path("geometry") / f"{name}.toml" for name in DRAWINGS[kind])
    options = TrialOptions(cases=cases, seed=seed, workers=workers, baselines=baselines, kind=kind)
    with status("Solving") as say:
        commitments = make_trial(drawings, output, options, say)
    print(f"{len(commitments)} cases in {output}; {output / 'manifest.json'} commits to their keys", flush=True)
    with status("Diagnosing") as say:
        judgements = run_trial(output, commitments, options, say)
    lines = trial_table(judgements)
    write_cases_csv(judgements, output / "cases.csv")
    write_json(
        json or output / "results.json",
        {
            "table": [line.to_dict() for line in lines],
            "by_effect": {
                name: {what: [share.hits, share.of] for what, share in shares.items()}
                for name, shares in by_effect(judgements).items()
            },
            "cases": [judgement.to_dict() for judgement in judgements],
        },
    )
    print("\n".join(line.text() for line in lines))
    print("\nby hidden effect of 1 and 3 sigma: in class, first, misnamed when withheld")
    for name, shares in by_effect(judgements).items():
        counted = "   ".join(f"{share.hits}/{share.of}" for share in shares.values())
        print(f"  {name:<34}{counted}")
