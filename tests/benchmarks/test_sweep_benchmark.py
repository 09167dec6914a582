"""Time and memory of the sweep, as users see them: whole commands, imports included.

Run with ``python -m pytest -m benchmark -s tests/benchmarks``. Nothing is asserted of the times; medians are printed.
"""

import resource
import statistics
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
    assert set(counts) == {100 if label == "plunger" else 488}
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0
    print(
        f"\nfemfit sweep, {label}, {counts[0]} points, 2 processes, imports included: median "
        f"{statistics.median(walls):.2f} s ({min(walls):.2f} to {max(walls):.2f}); peak memory of the largest process "
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
