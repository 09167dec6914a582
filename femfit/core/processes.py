"""Worker processes.

loky's processes do not import the script that started them, which therefore needs no ``__main__`` guard, and they can
be ended at once, in the middle of a solution, when the user interrupts.
"""

import os
import threading
import time

from loky import ProcessPoolExecutor

from femfit.core.errors import DomainError
from femfit.core.quoted import quoted


def process_pool(workers: int) -> ProcessPoolExecutor:
    """Make a pool of processes that end with this one, each with one thread for its linear algebra.

    End it by ``shutdown(kill_workers=True)`` where nobody will wait for what it still does.
    """
    if not isinstance(workers, int) or workers < 1:
        raise DomainError(f"The number of workers must be a whole number >= 1; instead received {quoted(workers)}.")
    # femfit's matrices are small: threads that wait for each other on shared cores cost up to twenty times the time
    threads = {"OPENBLAS_NUM_THREADS": os.environ.get("OPENBLAS_NUM_THREADS", "1")}
    return ProcessPoolExecutor(workers, initializer=_end_with, initargs=(os.getpid(),), env=threads)


def _end_with(parent: int) -> None:
    """Let this worker end when the process that started it is killed: nobody would ever give it a task again."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
