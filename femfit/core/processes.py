"""Worker processes.

loky's processes do not import the script that started them, which therefore needs no ``__main__`` guard, and they can
be ended at once, in the middle of a solution, when the user interrupts.

Ctrl-C and SIGTERM in code that swallows them.

A library in C++ that calls back into Python may turn the KeyboardInterrupt that a signal raises there into an error of
its own, or drop it: what was interrupted then looks like what failed.
"""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from multiprocessing import resource_tracker
from types import FrameType, TracebackType
from typing import ParamSpec, TypeVar

from loky import ProcessPoolExecutor

from femfit.core.errors import DomainError
from femfit.core.text import quoted

Handler = Callable[[int, FrameType | None], object]


@contextmanager
def kept_interrupts() -> Iterator[None]:
    """Raise again at the end what a signal's handler raised in the block, whatever became of it there.

    Only the main thread has signals: in others nothing changes.
    """
    raised: list[BaseException] = []
    before = {}

    def note(handler: Handler, number: int, frame: FrameType | None) -> None:
        try:
            handler(number, frame)
        except BaseException as interrupt:
            raised.append(interrupt)
            raise

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            if callable(handler := signal.getsignal(number)):
                before[number] = signal.signal(number, partial(note, handler))
    try:
        yield
    except Exception as error:
        if raised:
            raise raised[0] from error
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if raised:
        raise raised[0]


Given = ParamSpec("Given")
Result = TypeVar("Result")


class ProcessPool(ProcessPoolExecutor):  # type: ignore[misc]  # loky has no types
    """Processes that a Ctrl-C reaches through this one alone: a block that an error leaves kills them."""

    def submit(
        self, function: Callable[Given, Result], *arguments: Given.args, **by_name: Given.kwargs
    ) -> Future[Result]:
        """Hand out a task; a process that starts for it inherits that Ctrl-C, which a terminal sends to all, waits."""
        resource_tracker.ensure_running()  # its start, which belongs to that of a process, would end the blocking
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(function, *arguments, **by_name)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.shutdown(wait=kind is None, kill_workers=kind is not None)


def process_pool(workers: int) -> ProcessPool:
    """Make a pool of processes that end with this one, each with one thread for its linear algebra.

    End it by ``shutdown(kill_workers=True)``, or by an error in its block, where nobody will wait for what it still
    does.
    """
    if not isinstance(workers, int) or workers < 1:
        raise DomainError(f"The number of workers must be a whole number >= 1; instead received {quoted(workers)}.")
    # femfit's matrices are small: threads that wait for each other on shared cores cost up to twenty times the time
    threads = {"OPENBLAS_NUM_THREADS": os.environ.get("OPENBLAS_NUM_THREADS", "1")}
    return ProcessPool(workers, initializer=_end_with, initargs=(os.getpid(),), env=threads)


def _end_with(parent: int) -> None:
    """Let this worker end when the process that started it is killed: nobody would ever give it a task again."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
