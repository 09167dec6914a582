"""How long it takes until femfit can be used: ``import femfit`` and ``femfit --help``."""

import statistics
import subprocess
import sys
import time

import pytest

from support.command import FEMFIT

REPEATS = 9


def seconds(*command):
    """Median time on the wall of a command."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


@pytest.mark.benchmark
def test_time_until_femfit_can_be_used():
    python = seconds(sys.executable, "-c", "pass")
    imported = seconds(sys.executable, "-c", "import femfit")
    print(f"\npython -c pass: {python:.3f} s; import femfit: {imported - python:.3f} s beside it")
    print(f"femfit --help: {seconds(FEMFIT, '--help'):.3f} s")
