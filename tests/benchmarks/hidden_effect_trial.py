"""The study behind docs/trial.md: how often the diagnosis is right on the project's own drawings, beside baselines.

``python tests/benchmarks/hidden_effect_trial.py -o runs/trial --cases 300 --seed 7`` makes static bench campaigns;
``--kind series`` records levitated bodies in a closed loop. ``--kind devices`` tries a solenoid and a voice coil whose
truth is made by other physics than the catalogue's; ``--cases`` is then the benches a cause. The baselines need
scikit-learn (the extra ``test``).
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from femfit.cli.progress import progress
from femfit.core.atomic import write_json
from support.device_trial.drawings import FORMS
from support.device_trial.run import run_device_trial, table_lines
from support.device_trial.tables import solve_device
from support.trial_study.baselines import baseline_names
from support.trial_study.run import CampaignKind, TrialOptions, make_trial, run_trial, write_cases_csv
from support.trial_study.series_case import make_series_case, sizing_record
from support.trial_study.series_effects import SERIES_EFFECTS
from support.trial_study.table import by_effect, trial_table

DRAWINGS = {"bench": ("emaws-rig", "plunger-solenoid", "biased-electromagnet"), "series": ("emaws-rig",)}


def series_kind():
    """Records over time instead of static tables."""
    sized = {}

    def make(truth, model, order):
        if order.actuator not in sized:
            sized[order.actuator] = sizing_record(truth, model)
        return make_series_case(truth, model, order, sized[order.actuator])

    return CampaignKind(effects=lambda _truth: list(SERIES_EFFECTS), make=make, families=())


def try_devices(given):
    """Solve the forms of both devices, try them and print the counts."""
    devices = {name: solve_device(name, given.output / "forms", given.workers) for name in FORMS}
    records = max(1, 2 * given.cases // 3)
    with progress("measure and diagnose", "campaigns") as show:
        outcomes = run_device_trial(
            devices,
            given.output,
            seed=given.seed,
            benches=given.cases,
            records=records,
            clean=4 * given.cases,
            progress=show,
        )
    print("\n".join(table_lines(outcomes)))


def main():
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kind", choices=(*DRAWINGS, "devices"), default="bench")
    parser.add_argument("--drawing", type=Path, action="append", help="actuator files instead of the project's")
    given = parser.parse_args()
    if given.kind == "devices":
        try_devices(given)
        return
    drawings = given.drawing or [ROOT / "geometry" / f"{name}.toml" for name in DRAWINGS[given.kind]]
    kind = series_kind() if given.kind == "series" else CampaignKind()
    making = TrialOptions(cases=given.cases, seed=given.seed, workers=given.workers, kind=kind)
    with progress("solve and measure", "campaigns") as show:
        commitments = make_trial(drawings, given.output, making, show)
    options = TrialOptions(workers=given.workers, further=baseline_names)
    with progress("diagnose", "campaigns") as show:
        judgements = run_trial(given.output, commitments, options, show)
    lines = trial_table(judgements)
    write_cases_csv(judgements, given.output / "cases.csv")
    data = {"cases": [one.to_dict() for one in judgements], "table": [line.to_dict() for line in lines]}
    write_json(given.output / "results.json", data)
    print("\n".join(line.text() for line in lines))
    print("\nby hidden effect of 1 and 3 sigma: in class, first, misnamed when withheld")
    for name, shares in by_effect(judgements).items():
        print(f"  {name:<34}" + "   ".join(f"{share.hits}/{share.of}" for share in shares.values()))


if __name__ == "__main__":
    main()
