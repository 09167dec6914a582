"""What commands share: results as JSON, progress on standard error."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from femfit import __version__
from femfit.core import atomic


def write_json(path: Path | None, result: Mapping[str, Any]) -> None:
    """Write a command's result where ``--json FILE`` asked for it.

    Parameters
    ----------
    path : Path or None
        Of the file; None writes nothing.
    result : mapping
        JSON-ready.
    """
    if path is not None:
        atomic.write_json(path, {**result, "written_by": f"femfit {__version__}"})


@contextmanager
def status(text: str) -> Iterator[Callable[[str], None]]:
    """What is being done, on standard error, quiet when that is no terminal.

    Parameters
    ----------
    text : str
        What is being done first.

    Yields
    ------
    callable
        To be called with what is being done now.
    """
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status(text) as line:
        yield line.update


@contextmanager
def progress_bar(text: str) -> Iterator[Callable[[int, int], None] | None]:
    """A progress bar on standard error, quiet when that is no terminal.

    Parameters
    ----------
    text : str
        What is going on.

    Yields
    ------
    callable or None
        To be called with (done, total).
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(text)

        def show(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        yield show
