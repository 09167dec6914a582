"""A sweep's progress on standard error."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from femfit.cli.progress import progress

if TYPE_CHECKING:
    from femfit.field.sweep import SweepProgress


@contextmanager
def sweep_progress(name: str) -> "Iterator[Callable[[SweepProgress], None]]":
    """Show how far the sweep of an actuator is, and say where an edited drawing makes it begin anew."""
    said = False
    with progress(f"sweep {name}", "points") as show:

        def update(state: "SweepProgress") -> None:
            nonlocal said
            if state.redrawn and not said:
                said = True
                text = "the drawing, the solver's settings or versions are not those of this directory's last sweep"
                print(f"sweep {name}: {text}; it is solved anew", file=sys.stderr, flush=True)
            show(state.points_done, state.points)

        yield update
