"""How far a simulation of several parts is: a callable that is told the part, the samples done and all of them."""

from collections.abc import Callable

from femfit.simulation.loop import Show

LoopProgress = Callable[[str, int, int], None]
"""Takes what is simulated, how many samples are done, and of how many."""


def stage(progress: LoopProgress | None, name: str) -> Show | None:
    """What one part of the work is told, as it is said of that part alone."""
    if progress is None:
        return None
    return lambda done, total: progress(name, done, total)
