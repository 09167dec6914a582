"""The page of the constants of decisions, made from the files that hold them."""

import ast
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parents[2] / "femfit"
FILES = {
    "What is missing, what to measure next, the noise, and a drawing's numbers": PACKAGE / "identify" / "constants.py",
    "Windows of records, and their noise": PACKAGE / "identify" / "series" / "constants.py",
    "Which readings beside a model cannot be right": PACKAGE / "identify" / "plausible.py",
    "A remainder of unknown cause": PACKAGE / "identify" / "remainder.py",
    "What a measurement costs, and shows": PACKAGE / "identify" / "plan.py",
    "What a record shows, and what a filter makes of it": PACKAGE / "estimate",
    "A table to a model": PACKAGE / "fit" / "constants.py",
    "Which readings contradict all others": PACKAGE / "tables" / "outliers.py",
    "Which rows, samples and sensors of a measurement cannot be right": PACKAGE / "tables" / "checks.py",
    "In which order rows were measured": PACKAGE / "tables" / "measurement.py",
    "Which unit or sign a column seems to have": PACKAGE / "tables" / "units.py",
}


class Constant(NamedTuple):
    """An assignment at the top of a file, and the text below it."""

    names: str
    value: str
    text: str


def constants_of(path: Path) -> list[Constant]:
    """The numbers that a file assigns at its top, tuples and products of numbers too; of a folder all."""
    if path.is_dir():
        return [constant for file in sorted(path.rglob("*.py")) for constant in constants_of(file)]
    body = ast.parse(path.read_text(encoding="utf-8")).body
    found = []
    for statement, following in zip(body, [*body[1:], None], strict=True):
        if isinstance(statement, ast.Assign | ast.AnnAssign) and statement.value and _is_number(statement.value):
            target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
            text = following.value.value if _is_text(following) else ""
            found.append(Constant(_plain(target), _plain(statement.value), " ".join(text.split())))
    return found


def beside_algorithms(room: str) -> dict[str, list[Constant]]:
    """The constants of a room that stand beside their algorithms, by the file, and bound rounding or time."""
    files = sorted(set((PACKAGE / room).rglob("*.py")) - set(FILES.values()))
    return {file.relative_to(PACKAGE).as_posix(): rows for file in files if (rows := constants_of(file))}


def _plain(expression: ast.expr) -> str:
    """Source of an expression, a tuple without its brackets."""
    parts = expression.elts if isinstance(expression, ast.Tuple) else [expression]
    return ", ".join(ast.unparse(part) for part in parts)


def _is_number(value: ast.expr) -> bool:
    """Whether a value is made of numbers, or computed from some."""
    parts = [node for node in ast.walk(value) if isinstance(node, ast.Constant)]
    is_list = isinstance(value, ast.Dict | ast.Set | ast.JoinedStr)
    return bool(parts) and not is_list and all(type(part.value) in {int, float} for part in parts)


def _is_text(statement: ast.stmt | None) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def page() -> str:
    """The whole page."""
    sections = [_section(f"## {title}", constants_of(path)) for title, path in FILES.items()]
    sections.append(_BESIDE)
    sections += [_section(f"### `{file}`", rows) for file, rows in beside_algorithms("identify").items()]
    return _HEAD + "\n\n".join(sections) + "\n"


def _section(heading: str, constants: list[Constant]) -> str:
    rows = [f"| `{constant.names}` | {constant.value} | {constant.text} |" for constant in constants]
    return "\n".join([heading, "", "| constant | value | kind and source |", "|---|---|---|", *rows])


_HEAD = """\
# Constants of decisions

These are the numbers by which `femfit fit`, `compare`, `diagnose`, `add` and `suggest` decide. A *derived* number
follows from something else. A *conventional* one is a usual level. A *calibrated* one was set by trials with known
truth; the tables of [the trial](../trial.md) are of seeds that set none. An *assumed* one is an engineer's judgement
with no calibration behind it. A *numerical* one bounds rounding or time.

"""

_BESIDE = """\
## What bounds rounding and time in the identification

These decide nothing. Each stands beside the algorithm that it bounds."""
