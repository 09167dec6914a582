"""The same tasks on the workers of a Dask cluster.

The scheduler gives the tasks of a worker that dies to another one. What comes back is counted by task, so that none is
lost and none comes twice; a task whose workers die again and again is a failed row.
"""

import logging
import re
import socket
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from femfit import __version__
from femfit.core.errors import ClusterError
from femfit.field.sweep_pool import Done, Result, Solve, Task, work_off

if TYPE_CHECKING:
    from distributed import Client

ADDRESS = re.compile(r"(tcp|tls)://[^/@\s]+:[0-9]{1,5}")

OUT_AT_A_TIME = 1000
"""Tasks that the scheduler holds: enough for any cluster, few enough to watch."""

TIMEOUT = 30.0
"""Seconds for the scheduler to answer and for its first worker to come."""


def solve_on_cluster(tasks: Sequence[Task], solve: Solve[Task], done: Done[Task], scheduler: str) -> None:
    """Solve tasks on a Dask cluster."""
    with _dask_quiet(), _client(scheduler) as client:
        from distributed import KilledWorker  # noqa: PLC0415  an extra, like all of Dask

        executor = client.get_executor(pure=False)
        try:
            work_off(
                executor,
                deque(tasks),
                {},
                partial(solve_if_same, solve, versions()),
                done,
                OUT_AT_A_TIME,
                lost=(KilledWorker,),
            )
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
        given = ", ".join(f"{name} {here[name]}" for name in needed)
        raise ClusterError(
            f"All workers must have {', '.join(f'{name} {number}' for name, number in needed.items())}; one has "
            f"{given}. Install the same versions there, and give the same command again."
        )
    return solve(task)


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
    try:
        client.wait_for_workers(1, timeout=TIMEOUT)
    except TimeoutError as error:
        client.close()
        raise ClusterError(
            f"The scheduler at {scheduler} has no workers. Start some with dask worker {scheduler}."
        ) from error
    try:
        yield client
    finally:
        client.close()


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
