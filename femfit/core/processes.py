"""Worker processes, and calls in a process of their own.

loky's processes do not import the script that started them, which therefore needs no ``__main__`` guard, and they can
be ended at once, in the middle of a solution, when the user interrupts.

A process of its own is for libraries in C that a damaged file makes crash, hang or fill the memory. Such a library
holds the interpreter's lock while it hangs: neither a thread nor a signal's handler could end it from inside.

Ctrl-C and SIGTERM in code that swallows them.

A library in C++ that calls back into Python may turn the KeyboardInterrupt that a signal raises there into an error of
its own, or drop it: what was interrupted then looks like what failed.
"""

import math
import os
import pickle
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from multiprocessing import resource_tracker
from types import FrameType, TracebackType
from typing import Any, ParamSpec, TypeVar

from loky import ProcessPoolExecutor

from femfit.core.errors import DomainError, FemfitError
from femfit.core.text import quoted

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


_GRACE_S = 2
"""After which an alarm ends a child whose parent was killed and cannot. Chosen."""


class ChildError(Exception):
    """A child that died or took too long, or whose function failed; callers say more than its bare reason."""


def in_child(function: Callable[..., Any], *arguments: Any, timeout: float, memory: float) -> Any:
    """Call a function in a child process of so many bytes, which is killed after ``timeout`` s and by a Ctrl-C here.

    The function is imported there by its name; it, its arguments and its result must be picklable. An error of femfit
    is raised as it is, each other one as ChildError, too little memory as MemoryError.
    """
    limits = [str(math.ceil(timeout) + _GRACE_S), str(math.ceil(memory))]
    command = [sys.executable, "-P", "-m", "femfit.core.processes", *limits]
    task = pickle.dumps((function, arguments))
    # Libraries are found as here; a thread of linear algebra for each core would take the memory alone
    settings = {"PYTHONPATH": os.pathsep.join(map(str, sys.path)), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        child = subprocess.run(  # noqa: S603 - our own
            command, input=task, capture_output=True, timeout=timeout, check=False, env={**os.environ, **settings}
        )
    except subprocess.TimeoutExpired as error:
        raise ChildError(f"no end within {timeout:.0f} s") from error
    if child.returncode:
        how = f"signal {-child.returncode}" if child.returncode < 0 else f"code {child.returncode}"
        raise ChildError(f"the library that reads it ended with {how}")
    result, failure = pickle.loads(child.stdout)  # noqa: S301 - our own child wrote it
    if failure is not None:
        raise failure if isinstance(failure, FemfitError | MemoryError) else ChildError(failure)
    return result


def _answer() -> None:
    """Call what the parent asks for on standard input, and write its result and its error to standard output."""
    seconds, memory = map(int, sys.argv[1:])
    signal.alarm(seconds)  # the kernel's own end of this process, which no library holds up
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]  # which no process may raise
    memory = memory if hard == resource.RLIM_INFINITY else min(memory, hard)
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # what a library prints is no answer
        function, arguments = pickle.load(sys.stdin.buffer)  # noqa: S301 - our own parent wrote it
        try:
            answer = pickle.dumps((function(*arguments), None))
        except FemfitError as error:
            answer = pickle.dumps((None, error))
        except MemoryError:
            answer = pickle.dumps((None, MemoryError(f"{memory / 1e9:.3g} GB")))
        except Exception as error:  # noqa: BLE001  whatever a library raises; its own classes may not be picklable
            answer = pickle.dumps((None, f"{type(error).__name__}: {error}"))
        out.write(answer)


if __name__ == "__main__":
    _answer()
