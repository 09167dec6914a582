"""The trial of records over time of docs/trial.md: a solenoid that is switched and a voice coil that is swung.

``python tests/benchmarks/record_trial.py -o runs/records --cases 2 --seed 2028`` records each cause of
``support/trial/records.py`` so often, and as often nothing, diagnoses the records from their files and counts.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from femfit import fit_model, read_actuator, run_sweep, write_model
from femfit.core.files import write_json
from femfit.trial.campaigns import diagnose_campaigns
from support.trial.campaigns import read_judged, set_lines
from support.trial.records import CAUSES, record


def make_records(device: str, directory: Path, cases: int, seed: int, workers: int) -> list[int]:
    """Sweep the drawing of a device, fit its model and write its records with what they hide."""
    actuator = read_actuator(ROOT / "geometry" / f"{device}.toml")
    model = fit_model(run_sweep(actuator, directory / "sweep", workers=workers)).model
    directory.mkdir(parents=True, exist_ok=True)
    write_model(model, directory / "model.json")
    orders = [cause for cause in ("nothing", *CAUSES[device]) for _ in range(cases)]
    for number, cause in enumerate(orders, 1):
        rows, size = record(actuator, model, cause, np.random.default_rng([seed, number]))
        place = directory / "campaigns" / f"{number:04d}"
        place.mkdir(parents=True, exist_ok=True)
        rows.to_csv(place / "data.csv", index=False, float_format="%.9g")
        names = CAUSES[device].get(cause)
        key = {"level": 0.0, "hidden": {}, "over_noise": {}, "right": {}, "group": {}}
        if names is not None:
            group = "catalogue" if names else "unseen"
            key = {"level": 1.0, "hidden": {cause: size}, "over_noise": {cause: {}}}
            key |= {"right": {cause: names}, "group": {cause: group}}
        write_json(place / "hidden.json", key)
    return list(range(1, len(orders) + 1))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--cases", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    for device in CAUSES:
        directory = options.output / device
        numbers = make_records(device, directory, options.cases, options.seed, options.workers)
        outcomes = diagnose_campaigns(directory, numbers, workers=options.workers)
        print("\n".join([device, *set_lines(read_judged(directory, outcomes))]))
        for outcome in outcomes:
            names = "; ".join(", ".join(members) for members in outcome.classes)
            print(f"  {outcome.number:04d} {', '.join(outcome.hidden) or 'nothing'}: {names or outcome.verdict}")


if __name__ == "__main__":
    main()
