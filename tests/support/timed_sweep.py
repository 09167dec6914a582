"""The time of whole ``femfit sweep`` commands with two processes, imports and table included."""

import resource
import subprocess
import time
from importlib.resources import files

from femfit.device.load import starter_text
from support.actuators import GEOMETRY
from support.command import FEMFIT

SWEEPS = {
    "linear": ("emaws-rig", ""),
    "linear, tolerance of 0.1 %": ("emaws-rig", "\n[solver]\ntolerance = 1e-3\n"),
    "saturating": ("emaws-saturable", ""),
    "plunger": ("plunger-solenoid", ""),
    "push solenoid": ("solenoid", ""),
    "voice coil": ("voice-coil", ""),
    "relay": ("relay", ""),
}
"""Label -> a drawing of ``femfit new`` or of geometry/, and what is put below it."""


def timed(command):
    """Wall seconds of a command."""
    start = time.perf_counter()
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - start


def processor_seconds(work):
    """What a function returns, and the processor seconds of all processes that it started and waited for."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = work()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return found, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def timed_sweep(label, directory):
    """Wall seconds of a sweep of :data:`SWEEPS`, and its number of rows."""
    name, solver = SWEEPS[label]
    directory.mkdir(parents=True)
    actuator = directory / "actuator.toml"
    known = (files("femfit.device") / f"examples/{name}.toml").is_file()
    text = starter_text(name) if known else (GEOMETRY / f"{name}.toml").read_text(encoding="utf-8")
    actuator.write_text(text + solver, encoding="utf-8")
    seconds = timed([FEMFIT, "sweep", str(actuator), "-o", str(directory / "run"), "--workers", "2"])
    return seconds, (directory / "run" / "sweep.csv").read_text(encoding="utf-8").count("\n") - 1
