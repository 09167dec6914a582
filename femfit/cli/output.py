"""What commands share: results as JSON, what is being done on standard error."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from time import monotonic
from typing import Any

from femfit import __version__
from femfit.cli.progress import INTERVAL_S, duration
from femfit.core import atomic


def write_json(path: Path | None, result: Mapping[str, Any]) -> None:
    """Write a command's JSON-ready result where ``--json FILE`` asked for it."""
    if path is not None:
        atomic.write_json(path, {**result, "written_by": f"femfit {__version__}"})


@contextmanager
def status(text: str) -> Iterator[Callable[[str], None]]:
    """What is being done, on standard error, a line now and then where that is no terminal; yields what changes it."""
    if not sys.stderr.isatty():
        with _lines(text) as say:
            yield say
        return
    from rich.console import Console

    with Console(stderr=True).status(text) as line:
        yield line.update


@contextmanager
def _lines(text: str) -> Iterator[Callable[[str], None]]:
    """Print what is being done after ten seconds, and whenever that reads otherwise; short work prints nothing."""
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
