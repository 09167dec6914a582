"""What commands say while they run, on standard error: a bar on a terminal, and a line now and then elsewhere."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING

from femfit.core.results import Words, listing

if TYPE_CHECKING:
    from femfit.field.sweep import SweepProgress


INTERVAL_S = 10.0
"""Seconds between two lines where standard error is no terminal."""


Show = Callable[..., None]
"""Takes how much is done, of how much, and of which part of the work where it has several."""


@contextmanager
def progress(text: str, unit: str) -> Iterator[Show]:
    """Show how much of a piece of work is done, counted in a unit in the plural, and when it will end."""
    if not sys.stderr.isatty():
        with _counted(text, unit) as show:
            yield show
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn(unit))
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as bar:
        tasks = {"": bar.add_task(text, total=None)}

        def show(done: int, total: int, stage: str = "") -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(f"{stage} of {text}", total=total)
            bar.update(tasks[stage], completed=done, total=total)

        yield show


@contextmanager
def status(text: str) -> Iterator[Callable[[str], None]]:
    """Say what is being done, and yield what changes it."""
    if not sys.stderr.isatty():
        steps, start = [text], monotonic()
        with _lines(lambda: f"{steps[-1]}, {monotonic() - start:.0f} s after the start"):
            yield steps.append
        return
    from rich.console import Console

    with Console(stderr=True).status(text) as line:
        yield line.update


@contextmanager
def _lines(text: Callable[[], str]) -> Iterator[None]:
    """Print a line every ten seconds, whatever the work itself waits for."""
    ended = Event()

    def speak() -> None:
        while not ended.wait(INTERVAL_S):
            print(text(), file=sys.stderr, flush=True)

    speaker = Thread(target=speak, daemon=True)
    speaker.start()
    try:
        yield
    finally:
        ended.set()
        speaker.join()


@contextmanager
def _counted(text: str, unit: str) -> Iterator[Show]:
    """What there is at the begin is of an earlier run, and took no time of this one."""
    start, name, done_before, done_now, in_all = monotonic(), "", 0, 0, 0

    def show(done: int, total: int, stage: str = "") -> None:
        nonlocal start, name, done_before, done_now, in_all
        done_now, in_all = done, total
        before, name = name, f"{stage} of {text}" if stage else text
        if name != before:
            start, done_before = monotonic(), done
            if done and not stage:
                print(f"{text}: {done} of {total} {unit} were there already", file=sys.stderr, flush=True)

    def line() -> str:
        if done_now == done_before:
            return name or text
        remaining = (monotonic() - start) * (in_all - done_now) / (done_now - done_before)
        return f"{name}: {done_now} of {in_all} {unit}, about {remaining:.0f} s left"

    with _lines(line):
        yield show


@contextmanager
def sweep_progress(name: str) -> "Iterator[Callable[[SweepProgress], None]]":
    """Show how far the sweep of an actuator is, and say what changed where it begins anew."""
    with progress(f"sweep {name}", "points") as show:
        changes: list[str] = []

        def update(state: "SweepProgress") -> None:
            if state.changed and not changes:
                changes.extend(state.changed)
                text = f"not as in this directory's last sweep: {', '.join(changes)}; it is solved anew"
                print(f"sweep {name}: {text}", file=sys.stderr, flush=True)
            show(state.points_done, state.points)

        yield update


sentence = Words("femfit.cli", listing, names={}).sentence
"""What a macro of a command's text template makes of facts; the words stand in ``templates``."""
