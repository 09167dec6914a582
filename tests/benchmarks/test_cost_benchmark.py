"""What the field solver's work costs, against the number of points and of unknowns; writes docs/cost.md.

Processor seconds of one thread are disturbed less by other work on the machine than the time on the wall.
"""

import resource
import subprocess
import time
from functools import partial
from importlib.resources import files
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from jinja2 import Template

from femfit.device.load import read_actuator, starter_text
from femfit.field.layout import layout_of
from femfit.field.problem import LinearActuator
from femfit.field.sweep import run_sweep
from femfit.field.sweep_task import MESHES
from femfit.field.tolerance import SolverSettings
from support.actuators import GEOMETRY, swept_at
from support.command import FEMFIT

DOCS = Path(__file__).parents[2] / "docs"
REPEATS = 3
DISTANCES = (8, 15, 31, 61)
COMMANDS = {
    "linear": ("emaws-rig", "", REPEATS),
    "linear, tolerance of 0.1 %": ("emaws-rig", "\n[solver]\ntolerance = 1e-3\n", REPEATS),
    "saturating": ("emaws-saturable", "", 1),
    "push solenoid": ("solenoid", "", 1),
    "voice coil": ("voice-coil", "", 1),
    "relay": ("relay", "", 1),
}
"""Label -> a drawing of ``femfit new`` or of geometry/, what is put below it, and how often its sweep is timed."""
ELEMENTS = ((0.24, 1.0), (0.06, 0.3), (0.015, 0.15), (0.008, 0.08), (0.004, 0.05))
"""Fractions at the corners and within the parts, of the parts' extent, for 9,000 to 190,000 unknowns."""


def least(work):
    """Processor seconds of the quickest of the repeats."""
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def by_points(tmp_path):
    """(points, seconds at the default settings, seconds at a tolerance of 0.1 %) of sweeps in this process."""
    rig, fresh = read_actuator(GEOMETRY / "emaws-rig.toml"), count()

    def sweep_once(actuator, tolerance):
        MESHES.clear()  # as in a new process
        settings = SolverSettings(tolerance=tolerance)
        run_sweep(actuator, tmp_path / str(next(fresh)), workers=1, settings=settings)

    found = []
    for n in DISTANCES:
        chosen = np.array(rig.sweep.distances_m)[np.linspace(0, 60, n).round().astype(int)].tolist()
        swept = (partial(sweep_once, swept_at(rig, chosen), tolerance) for tolerance in (None, 1e-3))
        found.append((n * len(rig.sweep.currents_A), *map(least, swept)))
    return np.array(found)


def timed_command(name, solver, directory):
    """Points of a whole ``femfit sweep`` with two processes, and the processor seconds of all that it started."""
    directory.mkdir(parents=True)
    actuator = directory / "actuator.toml"
    known = (files("femfit.device") / f"examples/{name}.toml").is_file()
    text = starter_text(name) if known else (GEOMETRY / f"{name}.toml").read_text(encoding="utf-8")
    actuator.write_text(text + solver, encoding="utf-8")
    command = [FEMFIT, "sweep", str(actuator), "-o", str(directory / "run"), "--workers", "2"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    points = (directory / "run" / "sweep.csv").read_text(encoding="utf-8").count("\n") - 1
    return points, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def by_commands(tmp_path):
    """Label -> points and least processor seconds of the whole command, both processes together."""
    found = {}
    for label, (name, solver, repeats) in COMMANDS.items():
        runs = [timed_command(name, solver, tmp_path / label / str(repeat)) for repeat in range(repeats)]
        found[label] = (runs[0][0], min(seconds for _, seconds in runs))
    return found


def by_unknowns():
    """(unknowns, seconds, of these for the two factorisations) of one distance at order 5, without its mesh."""
    rig = read_actuator(GEOMETRY / "emaws-rig.toml")
    found = []
    for corner, region in ELEMENTS:
        settings = SolverSettings(corner_fraction=corner, region_fraction=region, grading=0.3)
        problem = LinearActuator(rig, (0.022,), layout_of(rig, settings), settings, estimate=False)
        whole, finest = least(partial(problem.solve, 0.022)), problem._system._levels[-1]
        found.append((problem.unknowns, whole, 2.0 * least(finest._inverse._inverse.Update)))
    return np.array(found)


def exponent(size, seconds):
    return float(np.polyfit(np.log(size), np.log(seconds), 1)[0])


def page(points, unknowns, commands):
    n, whole, factorising = unknowns.T
    powers = {
        "default": exponent(points[1:, 0], points[1:, 1]),
        "tolerant": exponent(points[1:, 0], points[1:, 2]),
        "usual": exponent(n[:-1], whole[:-1]),
        "largest": exponent(n, whole),
        "ideal": exponent(n, n * np.log(n)),
        "factorising": exponent(n, factorising),
        "rest": exponent(n, whole - factorising),
    }
    template = Template(Path(__file__).with_name("cost.md.j2").read_text(encoding="utf-8"), keep_trailing_newline=True)
    return template.render(powers=powers, points=points.tolist(), unknowns=unknowns.tolist(), commands=commands)


@pytest.mark.benchmark
def test_cost_against_points_and_unknowns(tmp_path):
    import ngsolve

    ngsolve.SetNumThreads(1)  # as the sweep's workers do
    text = page(by_points(tmp_path), by_unknowns(), by_commands(tmp_path))
    (DOCS / "cost.md").write_text(text, encoding="utf-8")
    print("\n" + text)
