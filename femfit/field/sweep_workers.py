"""The tasks of a sweep on processes of this machine or of a Dask cluster; one that kills its worker costs itself alone.

A process that dies breaks its pool and every task in it, and the pool does not say whose fault it was. So few tasks are
handed out at a time, those that were out are solved again, each in a process of its own, and the rest goes to a new
pool. A cluster's scheduler gives the tasks of a worker that dies to another one; a task whose workers die again and
again is a failed row.
"""

import logging
import re
import socket
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from femfit import __version__
from femfit.core.errors import ClusterError
from femfit.core.processes import process_pool

if TYPE_CHECKING:
    from distributed import Client

Task = TypeVar("Task")
Result = dict[str, Any]
Solve = Callable[[Task], Result]
Done = Callable[[Task, Result], Iterable[Task]]
"""Takes a task and its result here, as they come, and returns the tasks that follow from it; they are next."""

AGAIN = "again"
"""Mark of a result that the machine, not the task, is to blame for: the same command tries it again."""

DIED: Result = {"status": "failed: the worker process died (out of memory, or killed)", AGAIN: True}

SPARE, ON_CLUSTER = 1, 1000
"""Tasks handed out beyond the workers, so that none waits for its next one; and to a cluster of any size."""

ADDRESS = re.compile(r"(tcp|tls)://[^/@\s]+:[0-9]{1,5}")
TIMEOUT = 30.0
"""Seconds for the scheduler to answer and for its first worker to come."""


def solve_here(tasks: Sequence[Task], solve: Solve[Task], done: Done[Task]) -> None:
    """Solve tasks in this process."""
    waiting = deque(tasks)
    while waiting:
        task = waiting.popleft()
        _put_first(waiting, done(task, solve(task)))


def solve_in_processes(tasks: Sequence[Task], solve: Solve[Task], done: Done[Task], workers: int) -> None:
    """Solve tasks in processes of this machine; the result is :data:`DIED` where the task's own process died."""
    waiting = deque(tasks)
    while waiting:
        out: dict[Future[Result], Task] = {}
        pool = process_pool(workers)  # starts them as tasks come
        try:
            _work_off(pool, waiting, out, solve, done, workers + SPARE)
        except BrokenProcessPool:
            for task in out.values():
                _put_first(waiting, done(task, _alone(task, solve)))
        finally:
            pool.shutdown(wait=False, kill_workers=True)  # nothing is left to do, or the user will not wait for it


def solve_on_cluster(tasks: Sequence[Task], solve: Solve[Task], done: Done[Task], scheduler: str) -> None:
    """Solve tasks on a Dask cluster, whose workers have the versions of this process."""
    with _dask_quiet(), _client(scheduler) as client:
        from distributed import KilledWorker  # noqa: PLC0415  an extra, like all of Dask

        executor, same = client.get_executor(pure=False), partial(solve_if_same, solve, versions())
        try:
            _work_off(executor, deque(tasks), {}, same, done, ON_CLUSTER, lost=(KilledWorker,))
        except (CancelledError, OSError) as error:
            if isinstance(error, ClusterError) or client.status == "running":
                raise
            raise ClusterError(
                f"The scheduler at {scheduler} was lost. What was finished is kept: give the same command again, with "
                "a scheduler that runs or without one."
            ) from error


def versions() -> dict[str, str]:
    """What results depend on beside their task."""
    return {"femfit": __version__, "ngsolve": version("ngsolve")}


def solve_if_same(solve: Solve[Task], needed: dict[str, str], task: Task) -> Result:
    """Solve on a worker whose versions are those of the one who asks."""
    here = versions()
    if here != needed:
        versions_here = ", ".join(f"{name} {here[name]}" for name in needed)
        raise ClusterError(
            f"All workers must have {', '.join(f'{name} {number}' for name, number in needed.items())}; one has "
            f"{versions_here}. Install the same versions there, and give the same command again."
        )
    return solve(task)


def _put_first(waiting: deque[Task], tasks: Iterable[Task]) -> None:
    """Put tasks before all that wait, in their order: a worker may have the mesh of the one just done at hand."""
    waiting.extendleft(reversed(list(tasks)))


def _work_off(
    executor: Executor,
    waiting: deque[Task],
    out: dict[Future[Result], Task],
    solve: Solve[Task],
    done: Done[Task],
    limit: int,
    lost: tuple[type[BaseException], ...] = (),
) -> None:
    """Hand tasks out until all are done; ``out`` holds those that are out, also after an error."""
    try:
        while waiting or out:
            while waiting and len(out) < limit:
                out[executor.submit(solve, waiting[0])] = waiting[0]
                waiting.popleft()
            for future in wait(out, return_when=FIRST_COMPLETED).done:
                try:
                    result = future.result()
                except lost:
                    result = DIED
                _put_first(waiting, done(out.pop(future), result))
    except BaseException:
        for future in out:
            future.cancel()
        raise


def _alone(task: Task, solve: Solve[Task]) -> Result:
    pool = process_pool(1)
    try:
        return dict(pool.submit(solve, task).result())
    except BrokenProcessPool:
        return DIED
    finally:
        pool.shutdown(wait=False, kill_workers=True)


@contextmanager
def _client(scheduler: str) -> "Iterator[Client]":
    try:
        from distributed import Client  # noqa: PLC0415
    except ImportError as error:
        raise ClusterError(
            "A scheduler needs Dask, which is not installed. Install it with pip install 'femfit[cluster]'."
        ) from error
    _check_address(scheduler)
    try:
        client: Any = Client(scheduler, timeout=TIMEOUT, set_as_default=False)
    except OSError as error:
        raise ClusterError(
            f"What answers at {scheduler} is no Dask scheduler: {error}. Give the address of one."
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=TIMEOUT)
        except TimeoutError as error:
            raise ClusterError(
                f"The scheduler at {scheduler} has no workers. Start some with dask worker {scheduler}."
            ) from error
        yield client


def _check_address(scheduler: str) -> None:
    """Knock first: Dask's client takes a minute to give up, and then leaves a traceback."""
    problem = "it is no address"
    if ADDRESS.fullmatch(scheduler):
        try:
            parts = urlsplit(scheduler)
            with socket.create_connection((parts.hostname, parts.port), timeout=TIMEOUT):
                return
        except (OSError, ValueError) as error:
            problem = str(error)
    raise ClusterError(
        f"No scheduler answers at {scheduler!r}: {problem}. Start one with dask scheduler, and give its address, "
        "tcp://host:port."
    )


@contextmanager
def _dask_quiet() -> Iterator[None]:
    """Keep Dask from logging a lost connection as tracebacks; our error says it in a line."""
    with suppress(ImportError):
        import distributed  # noqa: F401, PLC0415  sets its loggers' levels
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
