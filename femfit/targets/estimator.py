"""Export a model as one file of plain Python: filters of its sensors, and its simulator.

What the model does is written from its graph, one line an instruction; around it stands a file that is written by hand
(``estimator.py.jinja``). Its numbers are femfit's to rounding.
"""

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import casadi as ca
from casadi import SX
from jinja2 import Environment, PackageLoader, StrictUndefined

from femfit import __version__
from femfit.core.errors import RunDirectoryError, UsageError
from femfit.core.graph import GraphFunction, building
from femfit.core.sweep_columns import voltage_columns
from femfit.core.tape import operation
from femfit.device.electrics import Drive
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.moments import UnscentedFilter
from femfit.estimate.noise import operating_distance
from femfit.estimate.process import FilterProcess
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import write_model
from femfit.model.sensors import reading_of
from femfit.simulation.plant import Plant

NEW = ".femfit_export.partial"
"""What an export that was interrupted leaves behind; the next one takes it away."""


def write_directory(model: ActuatorModel, directory: Path, texts: Mapping[str, str], mark: str) -> tuple[Path, ...]:
    """Write files by their names, and the model and the licence beside them; all of them.

    Parameters
    ----------
    mark : str
        The file that shows an earlier export.

    Raises
    ------
    RunDirectoryError
        If the directory is a file, or holds something else.
    """
    directory = Path(directory)
    _require_free(directory, mark)
    try:
        licence = distribution("femfit").read_text("licenses/LICENSE")
    except PackageNotFoundError:
        licence = None
    texts = dict(texts) if licence is None else {**texts, "LICENSE": licence}
    new, absent = directory / NEW, not directory.exists()
    shutil.rmtree(new, ignore_errors=True)
    try:
        new.mkdir(parents=True)  # refused where somebody laid a link in its place
        for name, text in texts.items():
            (new / name).write_text(text, encoding="utf-8")
        write_model(model, new / "model.json")
        for file in sorted(new.iterdir(), key=lambda file: file.name == mark):  # the mark last
            file.replace(directory / file.name)
    except OSError as error:
        place = str(error.filename or directory).replace(str(new), str(directory))  # a full disk names no file
        raise OSError(error.errno, error.strerror, place) from error
    finally:
        shutil.rmtree(new, ignore_errors=True)
        if absent and directory.exists() and not any(directory.iterdir()):
            directory.rmdir()
    return tuple(directory / name for name in (*texts, "model.json"))


def _require_free(directory: Path, mark: str) -> None:
    if not directory.exists():
        return
    if not directory.is_dir():
        raise RunDirectoryError(f"{directory} must be a directory to export to; it is a file. Choose another name.")
    earlier = any((directory / name).exists() for name in (mark, NEW, "femfit_runtime/__init__.py"))
    if any(directory.iterdir()) and not earlier:
        raise RunDirectoryError(
            f"{directory} must be absent, empty or an earlier export with {mark}; it holds other files. Choose another "
            "directory."
        )


def python_source(name: str, function: GraphFunction, arguments: Sequence[str]) -> str:
    """``def name(*arguments)``, which takes and gives lists of entries; and the tables that it looks up, before it."""
    tables, lines = [], [f"def {name}({', '.join(arguments)}):"]
    names = list(arguments)
    for number, (tape, rows) in enumerate(function.stages):
        lines += [f"    {line}" for line in _tape_lines(tape.function, names, f"y{number}")]
        first = 0
        for k, row in enumerate(rows):
            table = f"_{name}_{number}_{k}".upper()
            borders = [tuple(inner.tolist()) for inner in row.inner]
            tables += [f"{table} = {[tuple(entries) for entries in row.table.T.tolist()]!r}"]
            place = ", ".join(f"y{number}[{first + axis}]" for axis in range(len(borders)))
            lines.append(f"    r{number}_{k} = row({table}, {borders!r}, ({place},))")
            names.append(f"r{number}_{k}")
            first += len(borders)
    lines.append(f"    return y{len(function.stages) - 1}")
    return "\n".join([*tables, "", "", *lines])


def _tape_lines(function: ca.Function, names: Sequence[str], result: str) -> list[str]:
    held: dict[int, str] = {}
    lines, outputs = [], ["0.0"] * function.size1_out(0)
    for k in range(function.n_instructions()):
        number, to, of = function.instruction_id(k), function.instruction_output(k), function.instruction_input(k)
        if number == ca.OP_CONST:
            held[to[0]] = repr(function.instruction_constant(k))
        elif number == ca.OP_INPUT:
            held[to[0]] = f"{names[of[0]]}[{of[1]}]"
        elif number == ca.OP_OUTPUT:
            outputs[to[1]] = f"o{to[1]}"
            lines.append(f"o{to[1]} = {held[of[0]]}")
        else:
            lines.append(f"w{to[0]} = " + operation(number)[1].format(*(held[j] for j in of)))
            held[to[0]] = f"w{to[0]}"
    return [*lines, f"{result} = [{', '.join(outputs)}]"]


FILE = "estimator.py"


def export_estimator(model: ActuatorModel, directory: Path, sensors: Sequence[str] | None = None) -> tuple[Path, ...]:
    """Write the file, the model that it was made of, and a description.

    Raises
    ------
    MissingPartError
        If the model lacks circuit, motion, sensor or inductance.
    RunDirectoryError
        If the directory holds other files than an earlier export.
    """
    process = kalman_filter(model, sensors=sensors).process
    words = words_of(model, process)
    texts = {FILE: rendered(f"{FILE}.jinja", words), "README.md": rendered("estimator_readme.md.jinja", words)}
    return write_directory(model, directory, texts, FILE)


def words_of(model: ActuatorModel, process: FilterProcess) -> dict[str, Any]:
    """What the templates say of a model and its filter.

    Raises
    ------
    UsageError
        If a name of a circuit or sensor holds what no name in a program's text may.
    """
    if len(model.circuits) < 2:
        model.require_circuit()  # there is nothing to control without a winding
    names = tuple(output.name for output in process.outputs)
    for name in (*model.circuit_names, *names):
        if not re.fullmatch(r"[A-Za-z][\w.-]*", name, re.ASCII):
            raise UsageError(
                f"Names of circuits and sensors must begin with a letter and hold letters, digits, '_', '-' and '.' to "
                f"be exported; instead received {name!r}. Rename it in the model file."
            )
    readings = [reading_of(model, name) for name in names]
    columns = [reading.column or reading.name for reading in readings]
    commands = list(voltage_columns(model.circuit_names))
    first = [operating_distance(model), 0.0, *[0.0] * len(model.circuits)]
    functions = [python_source(name, function, arguments) for name, function, arguments in _functions(model, process)]
    listed = ", ".join(f"read_{k}" for k in range(len(names)))
    if process.order > process.base:
        functions.append("MOVED_ON = moved_on, moved_on_slope")
    else:
        functions.append("MOVED_ON = moved, moved_slope")
    functions.append(f"READ = [{listed}]\nREAD_SLOPES = [{listed.replace('read', 'read_slope')}]")
    return {
        "name": re.sub(r"[^\w .,:+()-]", "_", model.name),
        "version": __version__,
        "file": FILE,
        "states": list(process.names),
        "circuits": list(model.circuit_names),
        "sensors": list(names),
        "columns": ", ".join(("time_s", *commands, *columns)),
        "commands": commands,
        "reading_columns": columns,
        "sample_time_s": model.sample_time_s,
        "process_covariance": process.process_covariance.tolist(),
        "variances": [output.variance for output in process.outputs],
        "lowest": [reading.inner[0] for reading in readings],
        "highest": [reading.inner[1] for reading in readings],
        "start_covariance": process.start_covariance.tolist(),
        "lower": process.lower.tolist(),
        "upper": process.upper.tolist(),
        "scaling": UnscentedFilter(process).scaling,
        "steps": model.sample_step.count,
        "plant_steps": Plant(model).steps,
        "plant_order": model.order,
        "first": first,
        "functions": "\n\n\n".join(functions),
    }


def _functions(model: ActuatorModel, process: FilterProcess) -> list[tuple[str, GraphFunction, tuple[str, ...]]]:
    """Names, functions and arguments of what is written from the graph."""
    made = []
    with building():
        x, u = SX.sym("x", process.order), SX.sym("u", len(model.circuits))
        for first_step in dict.fromkeys([True, process.order == process.base]):
            name, moved = "moved" if first_step else "moved_on", process.moved(x, u, first=first_step)
            made += [(name, moved), (f"{name}_slope", ca.vec(ca.jacobian(moved, x).T))]
        for k, output in enumerate(process.outputs):
            reading = process.read(x, output.name)
            made += [(f"read_{k}", reading), (f"read_slope_{k}", ca.gradient(reading, x))]
        first = SX.sym("first", 2 + len(model.circuits))
        graphs: list[tuple[str, GraphFunction, tuple[str, ...]]]
        graphs = [("begun", GraphFunction([first], process.begun(first)), ("first",))]
        graphs += [(name, GraphFunction([x, u], value), ("x", "u")) for name, value in made]
    # The simulator takes the voltages that amplifiers give
    circuits = [replace(c, drive=Drive()) if c.drive.kind == "current" else c for c in model.circuits]
    fed = replace(model, circuits=tuple(circuits))
    with building():
        x, u = SX.sym("x", model.order), SX.sym("u", len(model.circuits))
        step = fed.sample_step.step(x, u, model.sample_time_s / Plant(model).steps, driven=True)[0]
        graphs.append(("plant_step", GraphFunction([x, u], step), ("x", "u")))
    return graphs


@cache
def _templates() -> Environment:
    environment = Environment(  # noqa: S701  no markup
        loader=PackageLoader("femfit.targets", "."), undefined=StrictUndefined, keep_trailing_newline=True
    )
    environment.filters["identifier"] = lambda name: re.sub(r"\W", "_", name).upper()
    environment.filters["listed"] = _listed
    return environment


def _listed(values: Sequence[float], real: str) -> str:
    """Numbers as C writes them; infinite ones as large as they come."""
    largest, suffix = (3e38, "f") if real == "float" else (1e300, "")
    numbers = [min(max(float(x), -largest), largest) for x in values]
    return ", ".join(f"{x!r}{suffix}" if "e" in repr(x) or "." in repr(x) else f"{x!r}.0{suffix}" for x in numbers)


def rendered(template: str, words: dict[str, Any]) -> str:
    """A template of this room with its words."""
    return _templates().get_template(template).render(words)
