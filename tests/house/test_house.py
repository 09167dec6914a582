"""The house rules: format, lint, types, layers, docstrings. One command, pytest, runs them all."""

import re
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


def test_continuous_integration_runs_the_readmes_test_command():
    readme = (ROOT / "README.md").read_text()
    commands = re.findall(r"```sh\n(.+?)\n```", readme, flags=re.DOTALL)
    assert "femfit run geometry/emaws-rig.toml" in commands[0]
    assert commands[1].endswith("-m pytest -n 2")
    assert "\n" not in commands[0] + commands[1]  # one line each
    script = (ROOT / ".ci" / "run").read_text()
    assert "README.md" in script
