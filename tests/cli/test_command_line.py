"""The command line as a whole: help, exit codes, interruption, a full disk."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from femfit.cli.main import COMMANDS
from femfit.model.json_file import write_model
from support.actuators import GEOMETRY
from support.command import FEMFIT, femfit, separate_femfit

RIG = str(GEOMETRY / "emaws-rig.toml")


@pytest.fixture(scope="module")
def small_actuator(tmp_path_factory):
    """The rig on a grid of 4 x 9 points, with small steps of the reference and long samples, enough for all."""
    text = Path(RIG).read_text()
    lines = []
    for line in text.splitlines():
        if line.startswith("current_A"):
            line = "current_A = [0, 0.4, 0.9, 1.4]"  # noqa: PLW2901
        if line.startswith("distance_mm = ["):
            line = "distance_mm = [24, 26]"  # noqa: PLW2901
        if line.startswith("distance_mm = {"):
            line = "distance_mm = [15, 16.5, 18, 20, 23, 27, 32, 38, 45]"  # noqa: PLW2901
        if line.startswith("sample_time_ms"):
            line = "sample_time_ms = 1.0"  # noqa: PLW2901
        lines.append(line)
    path = tmp_path_factory.mktemp("actuator") / "small.toml"
    path.write_text("\n".join(lines))
    return path


def test_help_lists_every_command():
    result = femfit("--help")
    assert result.returncode == 0
    for name, _, _ in COMMANDS:
        assert name in result.stdout


def test_help_imports_nothing_heavy():
    heavy = ("numpy", "pandas", "ngsolve", "cvxpy", "matplotlib", "scipy")
    code = f"import sys, femfit.cli.main as m; m.build_app(); print([n for n in {heavy} if n in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


@pytest.mark.parametrize("name", [name for name, _, _ in COMMANDS])
def test_every_command_explains_itself(name):
    result = femfit(name, "--help")
    assert result.returncode == 0
    assert "--json" in result.stdout or name == "new"  # which makes a drawing and has no result


@pytest.mark.parametrize("arguments", [("nosuch",), ("sweep",), ("fit",), ("sweep", RIG, "--workers", "0")])
def test_wrong_usage_exits_with_2(arguments):
    result = femfit(*arguments)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    "line",
    [
        "fit BENCH --model F9",
        "fit BENCH --model coenergy --constraints rising",
        "fit BENCH --model F1e --functions cubic,cubic",
        "fit BENCH --model F1e --bound d^-9=0:1",
        "fit BENCH --supply-V 12",
        "fit BENCH --where variant",
        "diagnose MODEL BENCH --exclude gremlins",
        "add MODEL gremlins BENCH -o NEW",
        "suggest MODEL",
        "compare MODEL BENCH --unit force_N",
        "export MODEL --to fmu -o NEW",
        "simulate MODEL --filter ukf9",
    ],
)
def test_a_name_that_there_is_not_and_a_malformed_option_exit_with_2(levitation_model, tmp_path, line):
    write_model(levitation_model, tmp_path / "model.json")
    grid = [(i, d) for i in (0.0, 0.5, 1.0, 1.4) for d in (0.016, 0.02, 0.025, 0.03, 0.035, 0.04)]
    rows = [f"{i},{d},{levitation_model.force(d, i)},{levitation_model.flux_linkage(d, i)}\n" for i, d in grid]
    (tmp_path / "bench.csv").write_text("current_A,distance_m,force_N,flux_linkage_Wb\n" + "".join(rows))
    files = {"MODEL": "model.json", "BENCH": "bench.csv", "NEW": "new"}
    result = femfit(*(files.get(word, word) for word in line.split()), cwd=tmp_path)
    assert result.returncode == 2, result.stderr
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", "nosuch.toml"), "does not exist"),
        (("sweep", "nosuch.toml"), "does not exist"),
        (("fit", "nosuch"), "does not exist"),
        (("export", "nosuch.json", "-o", "out"), "cannot be read"),
        (("simulate", "nosuch.json"), "cannot be read"),
        (("import", "nosuch.csv", "-o", "out"), "nosuch.csv"),
    ],
)
def test_an_error_exits_with_1_and_one_message(arguments, message, tmp_path):
    result = femfit(*arguments, cwd=tmp_path)
    assert result.returncode == 1
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_newer_model_file_is_refused_by_every_command_that_reads_one(levitation_model, tmp_path):
    path = tmp_path / "model.json"
    write_model(levitation_model, path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": 99}))
    for arguments in (("simulate", path), ("export", path, "-o", tmp_path / "out")):
        result = femfit(*arguments)
        assert result.returncode == 1
        assert "schema 99" in result.stderr
        assert "Update femfit" in result.stderr


@pytest.mark.parametrize(
    ("number", "code", "said"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "SIGTERM")]
)
def test_interrupted_sweep_keeps_its_points_and_goes_on(small_actuator, tmp_path, number, code, said):
    lines = small_actuator.read_text().splitlines()
    place = next(n for n, line in enumerate(lines) if line.startswith("distance_mm = ["))
    lines[place] = "distance_mm = { start = 15, stop = 45, step = 1 }"  # it must not end before it is interrupted
    many = tmp_path / "many.toml"
    many.write_text("\n".join(lines))
    journal = tmp_path / "run" / "journal.jsonl"
    command = [FEMFIT, "sweep", str(many), "-o", str(tmp_path / "run"), "--workers", "2"]
    # Where the tests run in the background, SIGINT is ignored, and a child would inherit that
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    child = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True)
    signal.signal(signal.SIGINT, before)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and child.poll() is None:
        if journal.exists() and journal.read_bytes().count(b"\n") > 2:
            os.killpg(child.pid, number)  # what Ctrl-C does: the whole group gets it
            break
        time.sleep(0.005)
    _, stderr = child.communicate(timeout=60)
    assert child.returncode == code
    assert said in stderr
    assert "what was finished is kept" in stderr
    kept = journal.read_bytes().count(b"\n") - 1
    assert kept >= 2
    result = femfit("sweep", many, "-o", tmp_path / "run", "--workers", 1, "--json", tmp_path / "summary.json")
    assert result.returncode == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["rows"], summary["failed"]) == (124, 0)


def test_progress_is_lines_of_text_where_there_is_no_terminal(small_actuator, tmp_path):
    result = separate_femfit("sweep", small_actuator, "-o", tmp_path / "run", "--workers", "1")
    assert result.returncode == 0
    assert "\r" not in result.stderr
    assert "\x1b" not in result.stderr
    assert len(result.stderr.splitlines()) <= 9  # one a distance at most
    assert "36 points, 0 failed" in result.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_is_a_message_and_exit_1(levitation_model, tmp_path):
    path = tmp_path / "model.json"
    write_model(levitation_model, path)
    result = femfit("export", path, "-o", tmp_path / "out", "--json", "/dev/full")
    assert result.returncode == 1
    assert "No space left" in result.stderr
    assert "Traceback" not in result.stderr


def test_run_does_the_whole_main_job(small_actuator, tmp_path):
    target = tmp_path / "run"
    result = femfit("run", small_actuator, "-o", target, "--workers", 1, "--json", tmp_path / "result.json")
    assert result.returncode == 0, result.stderr
    for name in ("sweep.parquet", "sweep.csv", "manifest.json", "model.json", "model_law.json", "report.html"):
        assert (target / name).stat().st_size > 0
    assert (target / "estimator" / "example.py").is_file()
    assert (target / "report.html").stat().st_size < 3e6
    data = json.loads((tmp_path / "result.json").read_text())
    assert data["closed_loop"] is not None
    assert data["sweep"]["failed"] == 0


@pytest.mark.long
def test_run_of_an_actuator_that_cannot_levitate_says_so(tmp_path):
    result = femfit("run", GEOMETRY / "plunger-solenoid.toml", "-o", tmp_path / "run")
    assert result.returncode == 0, result.stderr
    assert result.stdout.count("no sensor that a filter could read") == 1  # with its remedy, and not once a step
    assert "reluctance-network is taken" in result.stdout  # no sum of columns reaches the target for a plunger
    assert "[hall]" in result.stdout
    assert (tmp_path / "run" / "report.html").is_file()
    assert not (tmp_path / "run" / "estimator").exists()


def test_a_reader_that_has_seen_enough_is_no_error():
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as gone:
        done = subprocess.run(
            [FEMFIT, "audit", "--help"],
            stdout=gone, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    assert done.stderr == ""


def test_an_unforeseen_failure_is_one_line_with_a_log_file(monkeypatch, tmp_path):
    def broken(*arguments, **options):
        raise TypeError("something that nobody thought of\nand more")

    monkeypatch.setattr("femfit.targets.targets.export", broken)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    result = femfit("export", "model.json", "-o", tmp_path / "out")
    assert result.returncode == 70
    assert len(result.stderr.splitlines()) == 1
    assert "Traceback" not in result.stderr
    (log,) = tmp_path.glob("femfit-*.log")
    assert str(log) in result.stderr
    assert "TypeError" in log.read_text()
    assert "nobody thought of" in log.read_text()


def test_a_name_from_a_file_does_not_steer_the_terminal(tmp_path):
    result = femfit("export", "\x1b[31mmodel.json", "-o", tmp_path / "out")
    assert result.returncode == 1
    assert "\x1b" not in result.stderr
    assert "[31mmodel.json" in result.stderr


def test_too_little_memory_is_no_bug_of_femfit(monkeypatch, tmp_path):
    def greedy(*arguments, **options):
        raise MemoryError

    monkeypatch.setattr("femfit.targets.targets.export", greedy)
    result = femfit("export", "model.json", "-o", tmp_path / "out")
    assert result.returncode == 1
    assert "memory" in result.stderr


def test_a_terminal_that_knows_only_ascii_loses_no_result():
    code = "import sys, femfit.cli.main as m; m._print_what_the_terminal_can_show(); print('3.2 µm, 20 °C, ±1 Ω, ☂')"
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout == "3.2 um, 20 degC, +-1 ohm, ?\n"


def test_completion_of_the_shell_is_installed_by_one_command(tmp_path):
    result = separate_femfit("--install-completion", env=os.environ | {"HOME": str(tmp_path), "SHELL": "/bin/bash"})
    assert result.returncode == 0, result.stderr
    scripts = [path for path in tmp_path.rglob("*") if path.is_file() and "diagnose" in path.read_text()]
    assert scripts
