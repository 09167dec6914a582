"""Workers that come to grief at 20 mm, for tests of what a sweep makes of it."""

import dataclasses
import os
import resource
import signal
from pathlib import Path

from femfit.field.sweep_task import solve_task

LEFT = 40_000_000
"""Bytes, enough to think and too few to solve: a field of order 9 takes some hundreds of millions."""


def die_at_20_mm(task):
    """Solve a task, or die."""
    if task.distance == 0.02:
        os.kill(os.getpid(), signal.SIGKILL)
    return solve_task(task)


def starve_at_20_mm(task):
    """Solve a task, at 20 mm one that needs far more memory than there is."""
    if task.distance != 0.02:
        return solve_task(task)
    solve_task(task)  # what is imported does not count
    limits = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + LEFT, limits[1]))
    try:
        settings = dataclasses.replace(task.mesh.settings, order=9)
        return solve_task(dataclasses.replace(task, mesh=dataclasses.replace(task.mesh, settings=settings)))
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
