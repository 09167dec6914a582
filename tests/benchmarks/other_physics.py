"""The trial of docs/trial.md: campaigns that hide truths of other physics than the catalogue's, diagnosed and counted.

``python tests/benchmarks/other_physics.py final geometry/emaws-rig.toml -o runs/rig --cases 220 --seed 21`` takes one
of three sets that share no truth, to calibrate a decision, to develop it, and to report on it. Solving the changed
drawings takes some minutes, an hour where iron saturates; field solutions in the directory are used again.
"""

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import femfit as ff
from femfit.cli.output import progress
from femfit.core.files import write_json
from femfit.effects.catalogue import all_effects
from femfit.trial.campaigns import diagnose_campaigns, prepare_device
from femfit.trial.counts import Share, is_shown, right_names, trial_data
from support.trial.campaigns import measured_campaigns, read_judged, set_lines
from support.trial.sets import SETS, prepare_set

TWINS = {"force_offset": ("constant_force",), "constant_force": ("force_offset",)}
"""Effects that do the same to every channel of a bench: left out of the catalogue together."""


def certain_without_the_cause(directory, outcomes):
    """How often a name is called certain of a single visible error whose own name is out of the catalogue."""
    certain = []
    for outcome in (one for one in outcomes if len(one.hidden) == 1 and is_shown(one)):
        place = directory / "campaigns" / f"{outcome.number:04d}"
        key = json.loads((place / "hidden.json").read_text(encoding="utf-8"))
        right = [name for names in right_names(key).values() for name in names if name in all_effects()]
        if right:
            exclude = (*right, *(twin for name in right for twin in TWINS.get(name, ())))
            found = ff.diagnose(directory / "model.json", place / "data.csv", exclude=exclude)
            certain.append(found.confident)
    return Share(sum(certain), len(certain))


def main():
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
    without = certain_without_the_cause(output, outcomes)
    print(f"the cause taken out of the catalogue: a name was called certain in {without.hits} of {without.of}")
    print(f"left out: {options.cases - len(numbers)} campaigns of which the device cannot show what was to be hidden")
    for name, reason in truths.left_out.items():
        print(f"not hidden: {name} ({reason})")


if __name__ == "__main__":
    main()
