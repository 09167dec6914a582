"""Worker processes.

loky's processes do not import the script that started them, which therefore needs no ``__main__`` guard, and they can
be ended at once, in the middle of a solution, when the user interrupts.
"""

import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from multiprocessing import resource_tracker
from types import TracebackType
from typing import ParamSpec, TypeVar

from loky import ProcessPoolExecutor

from femfit.core.errors import DomainError
from femfit.core.quoted import quoted

Given = ParamSpec("Given")
Result = TypeVar("Result")


class ProcessPool(ProcessPoolExecutor):  # type: ignore[misc]  # loky has no types
    """Processes that a Ctrl-C reaches through this one alone: a block that an error leaves kills them."""

    def submit(self, function: Callable[Given, Result], *given: Given.args, **by_name: Given.kwargs) -> Future[Result]:
        """Hand out a task; a process that starts for it inherits that Ctrl-C, which a terminal sends to all, waits."""
        resource_tracker.ensure_running()  # its start, which belongs to that of a process, would end the blocking
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(function, *given, **by_name)  # type: ignore[no-any-return]
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
