"""The trial of docs/trial.md: campaigns that hide truths of other physics than the catalogue's, diagnosed and counted.

``python tests/benchmarks/other_physics.py final geometry/emaws-rig.toml -o runs/rig --cases 220 --seed 21`` takes one
of three sets that share no truth, to calibrate a decision, to develop it, and to report on it. Solving the changed
drawings takes some minutes, an hour where iron saturates; field solutions in the directory are used again.
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from femfit.cli.output import progress
from femfit.core.files import write_json
from femfit.trial.campaigns import prepare_device
from femfit.trial.counts import trial_data
from femfit.trial.run import diagnose_campaigns
from support.trial.campaigns import measured_campaigns, read_judged, set_lines
from support.trial.sets import SETS, prepare_set


def main():
    """Solve, measure, diagnose and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", choices=SETS)
    parser.add_argument("drawing", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    output, workers = options.output, options.workers
    device = prepare_device(options.drawing, output, workers=workers)
    with progress("solve the changed drawings", "points") as show:
        device, truths = prepare_set(
            options.drawing,
            device,
            output,
            options.set,
            workers=workers,
            progress=lambda done: show(done.points_done, done.points),
        )
    numbers = []
    for campaign in measured_campaigns(device, options.cases, options.seed, truths):
        campaign.write(output / "campaigns" / f"{campaign.number:04d}")
        numbers.append(campaign.number)
    with progress("diagnose", "campaigns") as show:
        outcomes = diagnose_campaigns(output, numbers, workers=workers, progress=show)
    write_json(output / "results.json", trial_data(outcomes))
    print("\n".join(set_lines(read_judged(output, outcomes))))
    print(f"left out: {options.cases - len(numbers)} campaigns of which the device cannot show what was to be hidden")
    for reason, names in truths.reasons().items():
        print(f"not hidden ({reason}): {', '.join(names)}")


if __name__ == "__main__":
    main()
