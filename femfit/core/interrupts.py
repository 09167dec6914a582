"""Ctrl-C and SIGTERM in code that swallows them.

A library in C++ that calls back into Python may turn the KeyboardInterrupt that a signal raises there into an error of
its own, or drop it: what was interrupted then looks like what failed.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import FrameType

Handler = Callable[[int, FrameType | None], object]


@contextmanager
def kept_interrupts() -> Iterator[None]:
    """Raise again at the end what a signal's handler raised in the block, whatever became of it there."""
    raised: list[BaseException] = []

    def note(handler: Handler, number: int, frame: FrameType | None) -> None:
        try:
            handler(number, frame)
        except BaseException as interrupt:
            raised.append(interrupt)
            raise

    try:
        with _handled_by(note):
            yield
    except Exception as error:
        if raised:
            raise raised[0] from error
        raise
    if raised:
        raise raised[0]


@contextmanager
def held_interrupts() -> Iterator[None]:
    """Let signals wait for the block's end, where it is short and a library would print them as errors of its own."""
    waiting: list[Callable[[], object]] = []

    def hold(handler: Handler, number: int, frame: FrameType | None) -> None:
        waiting.append(partial(handler, number, frame))

    try:
        with _handled_by(hold):
            yield
    finally:
        for handle in waiting:
            handle()


@contextmanager
def _handled_by(handle: Callable[[Handler, int, FrameType | None], None]) -> Iterator[None]:
    """Have signals handled so, given their own handlers. Only the main thread has signals: others change nothing."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            if callable(handler := signal.getsignal(number)):
                before[number] = signal.signal(number, partial(handle, handler))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
