"""The sweep on a real Dask cluster on loopback, whose workers die; and clusters that cannot be used."""

import dataclasses
import json
import os
import signal

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import ClusterError
from femfit.device.load import read_actuator
from femfit.field import sweep as sweep_module
from femfit.field import sweep_workers
from femfit.field.sweep import run_sweep
from femfit.field.sweep_workers import solve_if_same, versions
from femfit.field.tolerance import SolverSettings
from support.actuators import GEOMETRY
from support.cluster import cluster
from support.dying_worker import die_at_20_mm

QUICK = SolverSettings(order=3)


@pytest.fixture(scope="module")
def actuator():
    rig = read_actuator(GEOMETRY / "emaws-rig.toml")
    distances = tuple(np.round(np.linspace(0.015, 0.045, 31), 6).tolist())
    return dataclasses.replace(rig, sweep=dataclasses.replace(rig.sweep, distances_m=distances))


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
