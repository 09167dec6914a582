"""A sweep killed by SIGKILL, processes and all, and given again: the table of one that was never interrupted."""

import contextlib
import json
import signal
import subprocess
import time

import pandas as pd
import psutil
import pytest

from femfit.device.rewrite import read_variants
from femfit.field import sweep_task
from femfit.field.sweep import run_sweep
from support.actuators import GEOMETRY
from support.command import FEMFIT

AXIS = "{ start = 15, stop = 45, step = 5 }"
PATIENCE = 120.0  # seconds for a moment to come, on a busy machine


def actuator_file(kind, directory):
    """Ten solutions that share meshes, with warm starts where the core saturates."""
    text = (GEOMETRY / "emaws-variants.toml").read_text(encoding="utf-8")
    text = (
        text.replace("[308, 308, 250]", "[308, 250]")
        .replace("[20, 80, 20]", "[20, 80]")
        .replace("[10, 10, 11]", "[10, 11]")
    )
    text = text.replace(AXIS, "[15, 16, 17, 18, 19]")
    if kind != "variants":
        text = text[: text.index("\n[sweep.parameters]\n")].replace('design = "list"', "#")
        text = text.replace("[15, 16, 17, 18, 19]", "{ start = 15, stop = 19.5, step = 0.5 }")
    if kind == "saturating":
        text = text.replace('material = "ferrite"', 'material = "steel_1010"')
    path = directory / f"{kind}.toml"
    path.write_text(text, encoding="utf-8")
    return path


def kill_when(command, moment):
    """Run a command and kill it, not its workers, at a moment."""
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + PATIENCE
    while child.poll() is None and not moment():
        assert time.monotonic() < deadline
        time.sleep(0.005)
    children = []
    with contextlib.suppress(psutil.NoSuchProcess):
        children = psutil.Process(child.pid).children(recursive=True)
    child.send_signal(signal.SIGKILL)
    child.wait()
    return child.returncode, children


# A saturating sweep that is cut resumes bit for bit in test_nonlinear_sweep too, on a coarser mesh.
@pytest.mark.parametrize(
    "kind",
    [
        pytest.param("linear", marks=pytest.mark.nightly),
        pytest.param("saturating", marks=pytest.mark.nightly),
        "variants",
    ],
)
def test_a_sweep_killed_twice_ends_in_the_table_of_one_never_killed(kind, tmp_path):
    path = actuator_file(kind, tmp_path)
    sweep, target = read_variants(path), tmp_path / "killed"
    journal = target / "journal.jsonl"
    command = [FEMFIT, "sweep", str(path), "-o", str(target), "--workers", "2"]
    for lines in (2, 5):  # the header and one result, and some more: each time in the middle of others
        code, children = kill_when(command, lambda lines=lines: _lines(journal) >= lines)
        assert code == -signal.SIGKILL
        _, left = psutil.wait_procs(children, timeout=PATIENCE)
        assert left == []  # no worker outlives it
    before = [json.loads(line) for line in journal.read_bytes().splitlines()[1:] if line.endswith(b"}")]
    assert 4 <= len(before) < 10
    sweep_task.MESHES.clear()  # as in a new process
    resumed = run_sweep(sweep, target, workers=1)
    sweep_task.MESHES.clear()
    whole = run_sweep(sweep, tmp_path / "whole", workers=1)
    assert len(whole.rows) == 30
    assert (whole.rows["status"] == "ok").all()
    pd.testing.assert_frame_equal(resumed.rows, whole.rows, check_exact=True)
    for name in ("sweep.csv", "sweep.parquet", "manifest.json"):
        assert (target / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


@pytest.mark.nightly
def test_a_sweep_killed_while_it_writes_its_table_leaves_none_or_a_whole_one(tmp_path):
    path, target = actuator_file("linear", tmp_path), tmp_path / "run"
    run_sweep(read_variants(path), target, workers=1)
    expected = {name: (target / name).read_bytes() for name in ("sweep.csv", "sweep.parquet", "manifest.json")}
    for name in expected:
        (target / name).unlink()
    command = [FEMFIT, "sweep", str(path), "-o", str(target)]
    for name in expected:
        kill_when(command, lambda name=name: (target / name).exists())
        for other, content in expected.items():
            if (target / other).exists():
                assert (target / other).read_bytes() == content
    assert subprocess.run([*command], check=True, stdout=subprocess.DEVNULL).returncode == 0
    assert {name: (target / name).read_bytes() for name in expected} == expected
    assert {file.name for file in target.iterdir()} == {*expected, "journal.jsonl"}


def _lines(path):
    return path.read_bytes().count(b"\n") if path.exists() else 0
