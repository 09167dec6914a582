"""The house rules: format, lint, types, layers, docstrings. One command, pytest, runs them all."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from house.budgets import budgets, weights

ROOT = Path(__file__).parents[2]
SOURCES = (path for path in sorted((ROOT / "femfit").rglob("*.py")) if "    Parameters\n" in path.read_text())
CHECKS = {
    "format": ["-m", "ruff", "format", "--check", "femfit", "tests", "docs"],
    "lint": ["-m", "ruff", "check", "femfit", "tests", "docs"],
    "types": ["-m", "mypy"],
    "docstrings": ["-m", "numpydoc", "lint", *map(str, SOURCES)],
    "layers": [str(Path(sys.executable).with_name("lint-imports"))],
}


@pytest.mark.parametrize("name", CHECKS)
def test_tool_finds_nothing(name):
    result = subprocess.run([sys.executable, *CHECKS[name]], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


KINDS = ("Derived", "Conventional", "Calibrated", "Assumed", "Numerical")
NO_DECISION = {"fit/bounded_qp.py": "tolerances of the solver", "identify/misfit.py": "what a picture shows"}
CALIBRATED = 4
"""So many at most: what is set by the cases that it is judged by is not shown by them."""


def test_constants_of_fit_and_diagnosis_stand_in_one_file_a_decision_each_with_its_kind():
    constants = runpy.run_path(str(ROOT / "docs" / "_ext" / "constants.py"))
    files, constants_of = set(constants["FILES"].values()), constants["constants_of"]
    others = constants["beside_algorithms"]("fit") | constants["beside_algorithms"]("identify")
    deciding = {file for file, rows in others.items() if not all(row.text.startswith("Numerical") for row in rows)}
    assert deciding == set(NO_DECISION)
    every = [constant for path in files for constant in constants_of(path)]
    assert not [constant.names for constant in every if not constant.text.startswith(KINDS)]
    identified = [path for path in files if constants["PACKAGE"] / "identify" in path.parents]
    kinds = [constant.text.split(":")[0] for path in identified for constant in constants_of(path)]
    assert kinds.count("Calibrated") <= CALIBRATED


def test_continuous_integration_runs_the_readmes_test_command():
    readme = (ROOT / "README.md").read_text()
    commands = re.findall(r"```sh\n(.+?)\n```", readme, flags=re.DOTALL)
    assert "femfit run geometry/emaws-rig.toml" in commands[0]
    assert commands[1].endswith("-m pytest -n 2")
    assert "\n" not in commands[0] + commands[1]  # one line each
    script = (ROOT / ".ci" / "run").read_text()
    assert "README.md" in script


def test_every_file_that_a_newcomer_is_sent_to_is_there():
    table = (ROOT / "CONTRIBUTING.md").read_text().partition("Where is ... ?")[2].partition("\n- ")[0]
    files = re.findall(r"`([a-z_]+/[\w/.]+)`", table)
    assert len(files) > 15
    assert [file for file in files if not (ROOT / "femfit" / file).exists()] == []


SLACK = 1.03
"""How far above its weight a room's budget may lie before it is lowered."""


def test_every_room_keeps_its_budget_which_falls_with_it():
    allowed, weight = budgets(), weights()
    assert set(weight.index) == set(allowed.index)
    over = weight[(weight > allowed.loc[weight.index]).any(axis=1)]
    found = f"{over}\nthey may weigh:\n{allowed.loc[over.index]}"
    assert over.empty, f"find what stands twice before you add to these rooms:\n{found}"
    loose = allowed["code_lines"] > SLACK * weight["code_lines"] + 20
    assert not loose.any(), f"python tests/house/budgets.py lowers the budgets of {', '.join(loose[loose].index)}"
