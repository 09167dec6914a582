"""A real Dask scheduler and its workers, as processes on loopback."""

import contextlib
import os
import socket
import subprocess
import sys
from pathlib import Path

from distributed import Client

TESTS = Path(__file__).parents[1]


@contextlib.contextmanager
def cluster(workers=2, *, nanny=False, allowed_failures=3):
    """Address of a scheduler, its process and its workers' processes, all of which are there.

    A nanny starts its worker again when that dies.
    """
    address = f"tcp://127.0.0.1:{_free_port()}"
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")]).strip(os.pathsep),
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": str(allowed_failures),
        "OPENBLAS_NUM_THREADS": "1",
    }
    started = []

    def start(program, *arguments):
        command = [sys.executable, "-m", f"distributed.cli.dask_{program}", *arguments, "--no-dashboard"]
        quiet = subprocess.DEVNULL
        started.append(subprocess.Popen(command, env=environment, stdout=quiet, stderr=quiet, start_new_session=True))

    start("scheduler", "--host", "127.0.0.1", "--port", address.rsplit(":", 1)[1])
    for _ in range(workers):
        start("worker", address, "--nthreads", "1", "--memory-limit", "0", "--nanny" if nanny else "--no-nanny")
    try:
        with Client(address, timeout=60, set_as_default=False) as client:
            if workers:
                client.wait_for_workers(workers, timeout=60)
        yield address, started[0], started[1:]
    finally:
        for process in reversed(started):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, 9)
            process.wait()


def _free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
