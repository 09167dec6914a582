"""The house rules: format, lint, types, layers, docstrings. One command, pytest, runs them all."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "femfit").rglob("*.py"))
CHECKS = {
    "format": ["ruff", "format", "--check", "femfit", "tests", "docs"],
    "lint": ["ruff", "check", "femfit", "tests", "docs"],
    "types": ["mypy"],
    "docstrings": ["numpydoc", "lint", *SOURCES],
}


def run(command):
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", CHECKS)
def test_tool_finds_nothing(name):
    tool, *arguments = CHECKS[name]
    result = run([sys.executable, "-m", tool, *arguments])
    assert result.returncode == 0, result.stdout + result.stderr


def test_rooms_import_downwards_only():
    result = run([str(Path(sys.executable).with_name("lint-imports"))])
    assert result.returncode == 0, result.stdout + result.stderr


KINDS = ("Derived", "Conventional", "Calibrated", "Assumed", "Numerical")
NO_DECISION = {
    "comparison/curves.py": "what a picture shows",
    "comparison/misfit_maps.py": "what a picture shows",
    "decision/diagnosis_text.py": "how many names a sentence lists",
    "series/balances.py": "orders of a Taylor series that is kept for use again",
}


def test_constants_of_the_diagnosis_stand_in_one_file_a_decision_each_with_its_kind():
    constants = runpy.run_path(str(ROOT / "docs" / "_ext" / "constants.py"))
    room, files, constants_of = constants["IDENTIFY"], set(constants["FILES"].values()), constants["constants_of"]
    elsewhere = {
        path.relative_to(room).as_posix() for path in room.rglob("*.py") if path not in files and constants_of(path)
    }
    assert elsewhere == set(NO_DECISION)
    without_kind = [one.names for path in files for one in constants_of(path) if not one.text.startswith(KINDS)]
    assert not without_kind


def test_continuous_integration_runs_the_readmes_test_command():
    readme = (ROOT / "README.md").read_text()
    commands = re.findall(r"```sh\n(.+?)\n```", readme, flags=re.DOTALL)
    assert "femfit run geometry/emaws-rig.toml" in commands[0]
    assert commands[1].endswith("-m pytest -n 2")
    assert "\n" not in commands[0] + commands[1]  # one line each
    script = (ROOT / ".ci" / "run").read_text()
    assert "README.md" in script
