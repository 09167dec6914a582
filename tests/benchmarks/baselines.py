"""The comparison of docs/trial.md with LASSO, stepwise selection, PySINDy, symbolic regression and a Gaussian process.

``python tests/benchmarks/baselines.py runs/rig runs/voice`` reads directories that ``femfit trial --set final`` wrote,
tries femfit and each method whose package is installed (extra ``baselines``) on all their campaigns, and prints one
table for each directory.
"""

import argparse
import sys
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from femfit.cli.progress import progress
from femfit.core.atomic import write_json
from support.trial_study.baseline_table import compare_methods, comparison_lines


def main():
    """Try all methods and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, nargs="+")
    parser.add_argument("--json", type=Path, help="file for what each method said of each campaign")
    given = parser.parse_args()
    every = {}
    for directory in given.directory:
        with progress(f"compare on {directory}", "campaigns") as show:
            said = compare_methods(directory, show)
        every[str(directory)] = [asdict(one) for one in said]
        print("\n".join([f"{directory}:", *comparison_lines(said), ""]), flush=True)
    if given.json:
        write_json(given.json, every)


if __name__ == "__main__":
    main()
