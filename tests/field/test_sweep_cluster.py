"""The sweep on a real Dask cluster on loopback, whose workers die; and clusters that cannot be used."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from distributed import Client

from femfit.core.errors import ClusterError
from femfit.device.load import read_actuator
from femfit.field import sweep as sweep_module
from femfit.field import sweep_workers
from femfit.field.sweep import run_sweep
from femfit.field.sweep_workers import solve_if_same, versions
from femfit.field.tolerance import SolverSettings
from support.actuators import GEOMETRY, swept_at
from support.dying_worker import die_at_20_mm

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


QUICK = SolverSettings(order=3)


@pytest.fixture(scope="module")
def actuator():
    rig = read_actuator(GEOMETRY / "emaws-rig.toml")
    distances = tuple(np.round(np.linspace(0.015, 0.045, 31), 6).tolist())
    return swept_at(rig, distances)


def journal_keys(directory):
    lines = (directory / "journal.jsonl").read_text().splitlines()[1:]
    return [json.loads(line)["key"] for line in lines]


@pytest.mark.nightly
def test_a_worker_killed_half_way_costs_no_row_and_doubles_none(actuator, tmp_path):
    local = run_sweep(actuator, tmp_path / "local", workers=1, settings=QUICK)
    killed = []
    with cluster() as (address, _, workers):

        def kill_one(at):
            done = at.points_done
            if done >= at.points // 2 and not killed:
                os.kill(workers[0].pid, signal.SIGKILL)
                killed.append((done, workers[0].wait()))

        table = run_sweep(actuator, tmp_path / "run", scheduler=address, settings=QUICK, progress=kill_one)
        assert workers[1].poll() is None
    ((done, code),) = killed
    assert done < len(table.rows)
    assert code == -signal.SIGKILL
    keys = journal_keys(tmp_path / "run")
    assert len(keys) == len(set(keys)) == len(actuator.sweep.distances_m)
    assert not table.rows.duplicated(["current_A", "distance_m"]).any()
    pd.testing.assert_frame_equal(table.rows, local.rows, check_exact=True)


@pytest.mark.nightly
def test_a_distance_that_kills_every_worker_is_a_row_and_the_others_go_on(actuator, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_module, "solve_task", die_at_20_mm)
    with cluster(nanny=True, allowed_failures=1) as (address, _, _):
        table = run_sweep(actuator, tmp_path, scheduler=address, settings=QUICK)
    status = table.rows.groupby("distance_m")["status"].first()
    assert status[0.02].startswith("failed")
    assert (status.drop(0.02) == "ok").all()


def test_a_lost_scheduler_is_said_and_what_is_finished_is_kept(actuator, tmp_path):
    with cluster(workers=1) as (address, scheduler, _):

        def lose(at):
            if at.points_done and scheduler.poll() is None:
                scheduler.kill()
                scheduler.wait()

        with pytest.raises(ClusterError, match=r"lost"):
            run_sweep(actuator, tmp_path, scheduler=address, settings=QUICK, progress=lose)
    kept = journal_keys(tmp_path)
    assert 0 < len(kept) < len(actuator.sweep.distances_m)


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:9", "nonsense://x:1", "", "127.0.0.1:9", "tcp://127.0.0.1", "tcp://127.0.0.1:99999"]
)
def test_an_address_where_nothing_answers_is_refused_with_the_remedy(actuator, tmp_path, address):
    with pytest.raises(ClusterError, match=f"'{address}'"):
        run_sweep(actuator, tmp_path, scheduler=address, settings=QUICK)


def test_a_scheduler_without_workers_is_said(actuator, tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_workers, "TIMEOUT", 2.0)
    with cluster(workers=0) as (address, _, _), pytest.raises(ClusterError, match="dask worker"):
        run_sweep(actuator, tmp_path, scheduler=address, settings=QUICK)


def test_a_worker_with_other_versions_is_refused():
    needed = versions()
    assert solve_if_same(lambda task: {"status": task}, needed, "ok") == {"status": "ok"}
    with pytest.raises(ClusterError, match=r"ngsolve"):
        solve_if_same(lambda task: {"status": task}, needed | {"ngsolve": "5.0"}, "ok")
