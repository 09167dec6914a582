"""How often the measurement that ``femfit suggest`` advises makes a class of names smaller, with the truth still in it.

``python tests/benchmarks/advice.py geometry/emaws-rig.toml -o runs/rig --cases 100`` takes the campaigns of
``femfit trial --set development`` with that drawing, directory and seed, measures those whose class holds the truth
beside other names on as advised, and diagnoses them again. Field solutions in the directory are used again.
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from femfit.cli.progress import progress
from femfit.model.json_file import read_model
from femfit.trial.campaigns import prepare_device, prepare_set
from femfit.trial.truths.sets import SETS
from support.trial_study.advice import advice_lines, follow_advice


def main():
    """Follow the advice and print how often it helped."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drawing", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--set", choices=SETS, default="development")
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    device = prepare_device(given.drawing, given.output, workers=given.workers)
    device, truths = prepare_set(given.drawing, device, given.output, given.set, workers=given.workers)
    model = read_model(given.output / "model.json")
    with progress("follow the advice", "campaigns") as show:
        followed = list(
            follow_advice(device, model, truths, given.output, cases=given.cases, seed=given.seed, progress=show)
        )
    print("\n".join(advice_lines(followed)))


if __name__ == "__main__":
    main()
