"""Worker processes that do not run the user's script again.

The standard library's pool imports the main script in every process that it starts. A script that calls ``run_sweep``
without an ``if __name__ == "__main__"`` guard would then start itself in each worker, and wait for itself for ever.
The tasks here come from femfit's own modules, so that no worker needs the script.
"""

import multiprocessing
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import Any

_STARTING = threading.Lock()


def process_pool(workers: int, initializer: Callable[[], None] | None = None) -> ProcessPoolExecutor:
    """Make a pool of fresh processes, each with one thread for its linear algebra.

    Parameters
    ----------
    initializer : callable, optional
        Called once in each process before its first task.
    """
    return ProcessPoolExecutor(workers, mp_context=_Context(), initializer=initializer)


def end_with_parent() -> None:
    """Let this worker end when the process that started it is killed: nobody would ever give it a task again."""
    parent = multiprocessing.parent_process()
    if parent is not None:

        def watch() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=watch, daemon=True).start()


class _Process(SpawnProcess):
    """A process that is told nothing of the main script."""

    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802  the name that multiprocessing calls
        with _STARTING:
            main, threads = sys.modules["__main__"], os.environ.get("OPENBLAS_NUM_THREADS")
            sys.modules["__main__"] = ModuleType("__main__")  # without a file there is nothing to run again
            # Threads in many workers wait for each other; femfit's matrices are too small to gain from them
            os.environ["OPENBLAS_NUM_THREADS"] = threads or "1"
            try:
                return SpawnProcess._Popen(process_obj)  # noqa: SLF001
            finally:
                sys.modules["__main__"] = main
                if threads is None:
                    del os.environ["OPENBLAS_NUM_THREADS"]


class _Context(SpawnContext):
    Process = _Process
