"""What the signatures of a drawing's numbers cost beside its sweep, in processor seconds.

Run with ``python -m pytest -m benchmark -s tests/benchmarks``. Nothing is asserted of the times.
"""

import time

import ngsolve
import pytest

from femfit.device.drawn_numbers import read_numbers
from femfit.device.load import read_actuator
from femfit.field.currents import swept_currents
from femfit.field.settings import settings_for
from femfit.field.sweep import plan_sweep
from femfit.field.sweep_task import MeshCache
from support.actuators import GEOMETRY

MOST = 12
"""Distances of each sweep, evenly spread over it."""


@pytest.mark.benchmark
@pytest.mark.parametrize("name", ["emaws-rig", "ball", "voice-coil", "solenoid"])
def test_signatures_beside_the_plain_sweep(name):
    ngsolve.SetNumThreads(1)  # as the sweep's workers do
    path = GEOMETRY / f"{name}.toml"
    actuator, numbers, meshes = read_actuator(path), read_numbers(path), MeshCache()
    currents, spent = swept_currents(actuator.sweep), [0.0, 0.0]
    tasks = plan_sweep(actuator, settings_for(actuator))
    chosen = tasks[:: max(1, len(tasks) // MOST)]
    for task in chosen:
        start = time.process_time()
        problem = meshes.problem(task.mesh)
        problem.rows(task.distance, currents)
        middle = time.process_time()
        problem.signatures(task.distance, currents, numbers)
        spent = [spent[0] + middle - start, spent[1] + time.process_time() - middle]
    print(
        f"\n{name}: {len(numbers)} numbers, {len(chosen)} distances of {len(currents)} currents: sweep "
        f"{spent[0]:.1f} s, signatures {spent[1]:.1f} s more, {1.0 + spent[1] / spent[0]:.2f} times the plain sweep"
    )
