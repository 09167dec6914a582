"""What a simulation in open loop costs; run with ``-m benchmark -s``."""

import time

import pytest

from femfit.open_loop.simulate import simulate
from support.solenoids import solenoid

pytestmark = pytest.mark.benchmark


def test_the_pull_in_of_a_solenoid():
    model = solenoid()
    simulate(model, voltage_V=12.0)
    wall, processor = time.perf_counter(), time.process_time()
    motion = simulate(model, voltage_V=12.0)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    print(f"\n100 ms of a solenoid with one pull-in: {processor:.3f} s of computing, {wall:.3f} s")
    assert [one.kind for one in motion.switchings] == ["pull_in"]
