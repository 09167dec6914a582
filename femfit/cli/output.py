"""What commands say while they run, on standard error, and how signals end them.

Progress is a bar on a terminal, and a line now and then elsewhere.

SIGTERM and Ctrl-C end a command wherever it is, in the mesher and in a factorisation too. Python hands a signal on when
the main thread comes back from C, which may be never where a drawing takes the mesher hours. So a second thread reads
the signals, and ends the process where the first one has not heard of one in time.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment

    from femfit.field.sweep import SweepProgress
    from femfit.simulation.loop import LoopProgress


INTERVAL_S = 10.0
"""Seconds between two lines where standard error is no terminal."""

Show = Callable[[int, int], None]
"""Takes how much is done, and of how much."""


@contextmanager
def progress(text: str, unit: str) -> Iterator[Show]:
    """Show how much of a piece of work is done, counted in a unit in the plural, and when it will end."""
    if not sys.stderr.isatty():
        yield _progress_lines(text, unit)
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
    shown = False
    with progress(f"sweep {name}", "points") as show:

        def update(state: "SweepProgress") -> None:
            nonlocal shown
            if state.changed and not shown:
                shown = True
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

        def update(stage: str, done: int, total: int) -> None:
            nonlocal shown, show
            if show is None or stage != shown:
                parts.close()
                shown, show = stage, parts.enter_context(progress(f"{stage} of {name}", "samples"))
                show(0, total)
            show(done, total)

        yield update


def _progress_lines(text: str, unit: str) -> Show:
    """A line when the end can first be told, and then every ten seconds; work of a few seconds prints nothing."""
    start = printed = monotonic()
    before: int | None = None

    def show(done: int, total: int) -> None:
        nonlocal before, printed
        now, line = monotonic(), ""
        if before is None:
            before = done  # of an earlier run that was interrupted: it took no time of this one
            line = f"{done} of {total} {unit} were there already" if done else ""
        elif before < done < total:
            remaining = (now - start) * (total - done) / (done - before)
            if now - printed >= INTERVAL_S or (printed == start and remaining > INTERVAL_S):
                printed, line = now, f"{done} of {total} {unit}, about {duration(remaining)} left"
        if line:
            print(f"{text}: {line}", file=sys.stderr, flush=True)

    return show


def duration(seconds: float) -> str:
    """A time as one would say it: 40 s, 3 min, 1.5 h."""
    if seconds < 90.0:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


@contextmanager
def status(text: str) -> Iterator[Callable[[str], None]]:
    """What is being done, on standard error, a line now and then where that is no terminal; yields what changes it.

    There, it is printed after ten seconds and whenever it reads otherwise; short work prints nothing.
    """
    if sys.stderr.isatty():
        from rich.console import Console

        with Console(stderr=True).status(text) as line:
            yield line.update
        return
    doing, ended, start = [text], Event(), monotonic()

    def tell() -> None:
        printed = ""
        while not ended.wait(INTERVAL_S):
            line = f"{doing[0]}, {duration(monotonic() - start)} so far"
            if line != printed:
                print(line, file=sys.stderr, flush=True)
            printed = line

    teller = Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield lambda now: doing.__setitem__(0, now)
    finally:
        ended.set()
        teller.join()


PATIENCE = 2.0
"""Seconds that the main thread has to come back from C. Chosen: nobody waits longer before the next Ctrl-C."""


class EndedError(BaseException):
    """SIGTERM: not an Exception, so that nothing on the way takes it for an error of its own."""


WORDS = {
    signal.SIGTERM: "ended by SIGTERM; what was finished is kept",
    signal.SIGINT: "interrupted; what was finished is kept",
}


@contextmanager
def ending_on_signals() -> Iterator[None]:
    """Raise EndedError on SIGTERM and KeyboardInterrupt on Ctrl-C, or end the process where nothing can be raised.

    A Ctrl-C that the shell has this process ignore stays ignored. Only the main thread has signals; in another one
    nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard = threading.Event()

    def end(*_: object) -> None:
        heard.set()
        raise EndedError

    def interrupt(*_: object) -> None:
        heard.set()
        raise KeyboardInterrupt

    before = {signal.SIGTERM: signal.signal(signal.SIGTERM, end)}
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        before[signal.SIGINT] = signal.signal(signal.SIGINT, interrupt)
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    woken = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    watcher = threading.Thread(target=_watch, args=(reader, heard, set(before)), daemon=True)
    watcher.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(woken)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(writer)  # the watcher reads the end
        watcher.join(PATIENCE)


def _watch(reader: int, heard: threading.Event, numbers: set[signal.Signals]) -> None:
    """End the process on a signal that the main thread does not hear of."""
    while number := os.read(reader, 1):
        if number[0] in numbers and not heard.wait(PATIENCE):
            os.write(2, f"femfit: {WORDS[signal.Signals(number[0])]}\n".encode())
            os._exit(128 + number[0])
        heard.clear()
    os.close(reader)


def said(command: str, macro: str, *facts: object) -> str:
    """What a macro of a command's text template makes of facts; the words stand in ``templates``."""
    return str(getattr(_templates().get_template(f"{command}.txt.j2").module, macro)(*facts)).strip()


@cache
def _templates() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined

    from femfit.core.results import listing
    from femfit.core.text import amount, counted

    environment = Environment(
        loader=PackageLoader("femfit.cli"),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        autoescape=False,  # noqa: S701 - a terminal's text is no markup
    )
    environment.filters |= {"amount": amount, "counted": counted, "listing": listing}
    return environment
