"""Renew the golden results and say what changed: python tests/golden/renew.py [NAME ...] [--check]."""

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from golden import freeze
from golden.cases import CASES


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="cases, or what their names begin with; all by default")
    parser.add_argument("--check", action="store_true", help="change nothing; exit 1 on a difference beyond tolerance")
    parser.add_argument("--all", action="store_true", help="print differences within their tolerance too")
    given = parser.parse_args()
    wrong = False
    for name, run in CASES.items():
        if given.names and not any(name.startswith(one) for one in given.names):
            continue
        began = time.process_time()
        new, old = freeze.frozen(run()), freeze.read(name)
        print(f"{name}: {time.process_time() - began:.1f} s{'' if old else ', new'}", flush=True)  # noqa: T201
        found = [one for one in freeze.differences(old, new) if one[1] > (0.0 if given.all else 1.0)] if old else []
        wrong |= not old or any(one[1] > 1.0 for one in found)
        for path, error, before, after in sorted(found, key=lambda one: -one[1]):
            print(f"  {path}: {before!s:.60} -> {after!s:.60}, {error:.3g} of what is allowed")  # noqa: T201
        if not given.check:
            freeze.write(name, new)
    return int(given.check and wrong)


if __name__ == "__main__":
    raise SystemExit(main())
