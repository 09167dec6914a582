"""What commands share: results as JSON, what is being done on standard error."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from femfit import __version__
from femfit.core import atomic


def write_json(path: Path | None, result: Mapping[str, Any]) -> None:
    """Write a command's JSON-ready result where ``--json FILE`` asked for it."""
    if path is not None:
        atomic.write_json(path, {**result, "written_by": f"femfit {__version__}"})


@contextmanager
def status(text: str) -> Iterator[Callable[[str], None]]:
    """What is being done, on standard error, quiet when that is no terminal; yields what changes it."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status(text) as line:
        yield line.update
