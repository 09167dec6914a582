"""Functions of a model's graph as plain Python: one line an instruction, of numbers and of numpy's arrays alike."""

from collections.abc import Sequence

import casadi as ca

from femfit.core.graph import GraphFunction

_FORMS = {
    "ADD": "{} + {}", "SUB": "{} - {}", "MUL": "{} * {}", "DIV": "{} / {}", "NEG": "-{}", "SQ": "{0} * {0}",
    "TWICE": "2.0 * {}", "INV": "1.0 / {}", "ASSIGN": "{}", "EXP": "exp({})", "EXPM1": "expm1({})", "LOG": "log({})",
    "LOG1P": "log1p({})", "SQRT": "sqrt({})", "TANH": "tanh({})", "SIN": "sin({})", "COS": "cos({})", "TAN": "tan({})",
    "ATAN": "atan({})", "ATAN2": "atan2({}, {})", "SINH": "sinh({})", "COSH": "cosh({})", "ASINH": "asinh({})",
    "FLOOR": "floor({})", "FABS": "abs({})", "SIGN": "sign({})", "COPYSIGN": "copysign({}, {})", "FMAX": "fmax({}, {})",
    "FMIN": "fmin({}, {})", "POW": "power({}, {})", "CONSTPOW": "power({}, {})", "LE": "({} <= {})", "LT": "({} < {})",
    "EQ": "({} == {})", "NE": "({} != {})", "NOT": "not_({})", "AND": "and_({}, {})", "OR": "or_({}, {})",
    "IF_ELSE_ZERO": "where({}, {})",
}  # fmt: skip
_OPERATIONS = {getattr(ca, f"OP_{name}"): form for name, form in _FORMS.items()}


def python_source(name: str, function: GraphFunction, arguments: Sequence[str]) -> str:
    """``def name(*arguments)``, which takes and gives lists of entries; and the tables that it looks up, before it."""
    tables, lines = [], [f"def {name}({', '.join(arguments)}):"]
    known = list(arguments)
    for number, (tape, rows) in enumerate(function.graph.stages):
        lines += [f"    {line}" for line in _tape_lines(tape.function, known, f"y{number}")]
        first = 0
        for k, row in enumerate(rows):
            table = f"_{name}_{number}_{k}".upper()
            borders = [tuple(inner.tolist()) for inner in row.inner]
            tables += [f"{table} = {[tuple(entries) for entries in row.table.T.tolist()]!r}"]
            at = ", ".join(f"y{number}[{first + axis}]" for axis in range(len(borders)))
            lines.append(f"    r{number}_{k} = row({table}, {borders!r}, ({at},))")
            known.append(f"r{number}_{k}")
            first += len(borders)
    lines.append(f"    return y{len(function.graph.stages) - 1}")
    return "\n".join([*tables, "", "", *lines])


def _tape_lines(function: ca.Function, known: Sequence[str], result: str) -> list[str]:
    held: dict[int, str] = {}
    lines, outputs = [], ["0.0"] * function.size1_out(0)
    for k in range(function.n_instructions()):
        operation, to, of = function.instruction_id(k), function.instruction_output(k), function.instruction_input(k)
        if operation == ca.OP_CONST:
            held[to[0]] = repr(function.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            held[to[0]] = f"{known[of[0]]}[{of[1]}]"
        elif operation == ca.OP_OUTPUT:
            outputs[to[1]] = f"o{to[1]}"
            lines.append(f"o{to[1]} = {held[of[0]]}")
        else:
            lines.append(f"w{to[0]} = " + _OPERATIONS[operation].format(*(held[j] for j in of)))
            held[to[0]] = f"w{to[0]}"
    return [*lines, f"{result} = [{', '.join(outputs)}]"]
