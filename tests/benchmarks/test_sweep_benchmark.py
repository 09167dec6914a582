"""Time and memory of the sweep, as users see them: whole commands, imports included.

Run with ``python -m pytest -m benchmark -s tests/benchmarks``. Nothing is asserted of the times; medians are printed.
"""

import os
import resource
import signal
import statistics
import subprocess
import time

import ngsolve
import pytest

from femfit.device.load import read_actuator
from femfit.field.settings import SolverSettings
from support.actuators import GEOMETRY
from support.command import FEMFIT
from support.field import prepared
from support.timed_sweep import SWEEPS, timed, timed_sweep

REPEATS = 5


@pytest.mark.benchmark
@pytest.mark.parametrize("label", SWEEPS)
def test_whole_sweep_command(label, tmp_path):
    walls, counts = zip(*(timed_sweep(label, tmp_path / str(repeat)) for repeat in range(REPEATS)), strict=True)
    assert len(set(counts)) == 1
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0
    print(
        f"\nfemfit sweep, {label}, {counts[0]} points, 2 processes, imports included: median "
        f"{statistics.median(walls):.2f} s ({min(walls):.2f} to {max(walls):.2f}), "
        f"{100.0 * statistics.median(walls) / counts[0]:.1f} s for 100 points; peak memory of the largest process "
        f"{peak:.0f} MB"
    )


@pytest.mark.benchmark
def test_one_distance():
    ngsolve.SetNumThreads(1)  # as the sweep's workers do
    actuator = read_actuator(GEOMETRY / "emaws-rig.toml")
    start = time.perf_counter()
    problem = prepared(actuator, 0.022)
    mesh_time = time.perf_counter() - start
    times = []
    for distance in (0.021, 0.022, 0.023, 0.024, 0.025, 0.026, 0.027):
        start = time.perf_counter()
        problem.solve(distance)
        times.append(time.perf_counter() - start)
    order = SolverSettings().order
    print(
        f"\none mesh of {problem.mesh.ne} elements, {problem.unknowns} unknowns at order {order}: {mesh_time:.3f} s; "
        f"one distance (orders {order} and {order - 1}, self-force, all currents): "
        f"median {statistics.median(times):.3f} s"
    )


@pytest.mark.benchmark
def test_help_is_quick():
    walls = [timed([FEMFIT, "--help"]) for _ in range(REPEATS)]
    print(f"\nfemfit --help: median {statistics.median(walls):.2f} s ({min(walls):.2f} to {max(walls):.2f})")


@pytest.mark.benchmark
def test_an_interrupt_is_answered_at_once(tmp_path):
    """From Ctrl-C in the middle of saturating solutions to the end of the command and of its workers."""
    waits = []
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a child would inherit that it is ignored
    try:
        for repeat in range(REPEATS):
            target = tmp_path / str(repeat)
            command = [FEMFIT, "sweep", str(GEOMETRY / "emaws-saturable.toml"), "-o", str(target), "--workers", "2"]
            child = subprocess.Popen(
                command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
            )
            while not (target / "journal.jsonl").exists() or (target / "journal.jsonl").read_bytes().count(b"\n") < 3:
                time.sleep(0.01)
            start = time.perf_counter()
            os.killpg(child.pid, signal.SIGINT)
            _, text = child.communicate()
            waits.append(time.perf_counter() - start)
            assert child.returncode == 130
            assert "kept" in text
    finally:
        signal.signal(signal.SIGINT, before)
    print(f"\nCtrl-C during a sweep: answered in {statistics.median(waits):.2f} s ({max(waits):.2f} at most)")
