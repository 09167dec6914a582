"""How far a piece of work is, on standard error: a bar on a terminal, a line now and then elsewhere."""

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from time import monotonic
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from femfit.field.sweep import SweepProgress
    from femfit.simulation.loop_progress import LoopProgress

INTERVAL_S = 10.0
"""Seconds between two lines where standard error is no terminal."""

Show = Callable[[int, int], None]
"""Takes how much is done, and of how much."""


@contextmanager
def progress(text: str, unit: str) -> Iterator[Show]:
    """Show how much of a piece of work is done, counted in a unit in the plural, and when it will end."""
    if not sys.stderr.isatty():
        yield _Lines(text, unit)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn(unit))
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as bar:
        task = bar.add_task(text, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def sweep_progress(name: str) -> "Iterator[Callable[[SweepProgress], None]]":
    """Show how far the sweep of an actuator is, and say what changed where it begins anew."""
    said = False
    with progress(f"sweep {name}", "points") as show:

        def update(state: "SweepProgress") -> None:
            nonlocal said
            if state.changed and not said:
                said = True
                text = f"not as in this directory's last sweep: {', '.join(state.changed)}"
                print(f"sweep {name}: {text}; it is solved anew", file=sys.stderr, flush=True)
            show(state.points_done, state.points)

        yield update


@contextmanager
def loop_progress(name: str) -> "Iterator[LoopProgress]":
    """Show how far the closed loops of a model are, part by part."""
    with ExitStack() as parts:
        shown = ""
        show: Show | None = None

        def update(part: str, done: int, total: int) -> None:
            nonlocal shown, show
            if show is None or part != shown:
                parts.close()
                shown, show = part, parts.enter_context(progress(f"{part} of {name}", "samples"))
                show(0, total)
            show(done, total)

        yield update


class _Lines:
    """A line when the end can first be told, and then every ten seconds; work of a few seconds prints nothing."""

    def __init__(self, text: str, unit: str) -> None:
        self._text, self._unit = text, unit
        self._start = self._last = monotonic()
        self._before: int | None = None
        self._told = False

    def __call__(self, done: int, total: int) -> None:
        now = monotonic()
        if self._before is None:
            self._before = done  # of an earlier run that was interrupted: it took no time of this one
            if done:
                self._print(f"{done} of {total} {self._unit} were there already")
            return
        new = done - self._before
        if new <= 0 or done >= total:
            return
        left = (now - self._start) * (total - done) / new
        if now - self._last >= INTERVAL_S or (not self._told and left > INTERVAL_S):
            self._last, self._told = now, True
            self._print(f"{done} of {total} {self._unit}, about {duration(left)} left")

    def _print(self, text: str) -> None:
        print(f"{self._text}: {text}", file=sys.stderr, flush=True)


def duration(seconds: float) -> str:
    """A time as one would say it: 40 s, 3 min, 1.5 h."""
    if seconds < 90.0:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
