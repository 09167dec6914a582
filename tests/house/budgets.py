"""What each room of the package weighs, and the budgets that it keeps: ``python tests/house/budgets.py`` lowers them.

A code line is one that is neither blank, nor a comment, nor inside of a docstring; imports count.
"""

import ast
from pathlib import Path

import pandas as pd

from femfit.effects.catalogue import BUILT_IN

PACKAGE = Path(__file__).parents[2] / "femfit"
BUDGETS = Path(__file__).with_name("budgets.csv")
EFFECTS, OF_AN_EFFECT = 44, {"files": 1, "code_lines": 60, "functions": 3}
"""How many effects the catalogue had when their room was weighed, and what each further one may weigh; whoever lowers
the budgets counts them anew."""


def code_lines(text, tree):
    documented = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, clean=False):
            documented |= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    numbered = enumerate(map(str.strip, text.splitlines()), 1)
    return sum(bool(line) and not line.startswith("#") and number not in documented for number, line in numbered)


def weights():
    """Files, code lines and functions of each room; ``femfit`` itself is the room of the files at its top."""
    rows = []
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text()
        tree = ast.parse(text)
        functions = sum(isinstance(node, ast.FunctionDef) for node in ast.walk(tree))
        room = (path.relative_to(PACKAGE).parent.parts or ("femfit",))[0]
        rows.append((room, 1, code_lines(text, tree), functions))
    table = pd.DataFrame(rows, columns=["room", "files", "code_lines", "functions"])
    return table.groupby("room").sum().sort_index()


def budgets():
    allowed = pd.read_csv(BUDGETS, index_col="room")
    for unit, weight in OF_AN_EFFECT.items():
        allowed.loc["effects", unit] += (len(BUILT_IN) - EFFECTS) * weight
    return allowed


if __name__ == "__main__":
    kept, measured = budgets(), weights()
    lowered = measured.where(~(measured > kept.reindex(measured.index)), kept.reindex(measured.index))
    lowered.astype(int).to_csv(BUDGETS)
    print(lowered.astype(int).assign(measured=measured["code_lines"]).to_string())  # noqa: T201  a script
