"""Time and memory of the sweep, as users see them: whole commands, imports included.

Run with ``python -m pytest -m benchmark -s tests/benchmarks``. Nothing is asserted of the times; medians are printed.
"""

import resource
import statistics
import subprocess
import time

import ngsolve
import pytest

from femfit.actuator.load import read_actuator
from femfit.fem.settings import SolverSettings
from support.actuators import GEOMETRY
from support.command import FEMFIT
from support.field import prepared

REPEATS = 5


def timed(command):
    """Wall seconds of a command."""
    start = time.perf_counter()
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - start


@pytest.mark.benchmark
@pytest.mark.parametrize(
    ("name", "solver", "points"),
    [
        ("emaws-rig", "", 488),
        ("emaws-rig", "\n[solver]\ntolerance = 1e-3\n", 488),
        ("plunger-solenoid", "", 100),
        ("emaws-saturable", "", 488),
    ],
    ids=["linear", "linear to 0.1 %", "plunger", "saturating"],
)
def test_whole_sweep_command(name, solver, points, tmp_path):
    actuator = tmp_path / "actuator.toml"
    actuator.write_text((GEOMETRY / f"{name}.toml").read_text() + solver)
    walls, peaks = [], []
    for repeat in range(REPEATS):
        command = [FEMFIT, "sweep", str(actuator), "-o", str(tmp_path / str(repeat)), "--workers", "2"]
        walls.append(timed(command))
        peaks.append(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0)
    rows = (tmp_path / "0" / "sweep.csv").read_text().count("\n") - 1
    assert rows == points
    work = f"{name}{' to 0.1 %' if solver else ''}, {rows} points"
    print(
        f"\nfemfit sweep {work}, 2 processes, imports included: median {statistics.median(walls):.2f} s "
        f"({min(walls):.2f} to {max(walls):.2f}); peak memory of the largest process {max(peaks):.0f} MB"
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
