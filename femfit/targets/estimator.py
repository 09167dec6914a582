"""Export a model as one file of plain Python: filters of its sensors, and its simulator.

What the model does is written from its graph, one line an instruction; around it stands a file that is written by hand
(``estimator.py.jinja``). Its numbers are femfit's to rounding.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from casadi import SX
from jinja2 import Environment, PackageLoader, StrictUndefined

from femfit import __version__
from femfit.core.errors import UsageError
from femfit.core.graph import GraphFunction, building
from femfit.core.sweep_columns import voltage_columns
from femfit.device.electrics import Drive
from femfit.estimate.kalman_filter import UnscentedFilter
from femfit.estimate.levitation import levitation_process
from femfit.estimate.noise import operating_distance
from femfit.estimate.process import FilterProcess
from femfit.model.actuator_model import ActuatorModel
from femfit.model.sensors import reading_of
from femfit.simulation.plant import Plant
from femfit.targets.directory import write_directory
from femfit.targets.python_source import python_source

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
    if len(model.circuits) < 2:
        model.require_circuit()  # there is nothing to control without a winding
    process = levitation_process(model, sensors=sensors, hall_bias=True)
    words = words_of(model, process)
    texts = {FILE: estimator_text(words), "README.md": rendered("estimator_readme.md.jinja", words)}
    return write_directory(model, directory, texts, FILE)


def words_of(model: ActuatorModel, process: FilterProcess) -> dict[str, Any]:
    """What the templates say of a model and its filter.

    Raises
    ------
    UsageError
        If a name of a circuit or sensor holds what no name in a program's text may.
    """
    names = tuple(output.name for output in process.outputs)
    for name in (*model.circuit_names, *names):
        if not re.fullmatch(r"[A-Za-z][\w.-]*", name, re.ASCII):
            raise UsageError(
                f"Names of circuits and sensors must begin with a letter and hold letters, digits, '_', '-' and '.' to "
                f"be exported; instead received {name!r}. Rename it in the model file."
            )
    columns = [reading_of(model, name).column or name for name in names]
    commands = list(voltage_columns(model.circuit_names))
    first = [operating_distance(model), 0.0, *[0.0] * len(model.circuits)]
    functions = [python_source(name, function, arguments) for name, function, arguments in _functions(model, process)]
    listed = ", ".join(f"read_{k}" for k in range(len(names)))
    if process.graph.samples:
        functions.append("MOVED_ON = moved_on, moved_on_slope")
    else:
        functions.append("MOVED_ON = moved, moved_slope")
    functions.append(f"READ = [{listed}]\nREAD_SLOPES = [{listed.replace('read', 'read_slope')}]")
    lower, upper = process.lower, process.upper
    assert lower is not None  # noqa: S101  a levitation process has both
    assert upper is not None  # noqa: S101
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
        "start_covariance": process.require_start_covariance().tolist(),
        "lower": _plain(lower),
        "upper": _plain(upper),
        "scaling": UnscentedFilter(process).scaling,
        "steps": model.sample_step.count,
        "plant_steps": Plant(model).steps,
        "plant_order": model.order,
        "first": first,
        "functions": "\n\n\n".join(functions),
    }


def _functions(model: ActuatorModel, process: FilterProcess) -> list[tuple[str, GraphFunction, tuple[str, ...]]]:
    """Names, functions and arguments of what is written from the graph."""
    graph, made = process.graph, []
    with building():
        x, u = SX.sym("x", graph.order), SX.sym("u", len(model.circuits))
        for name, moved in (("moved", graph.moved(x, u)), ("moved_on", graph.moved_on(x, u))):
            if name == "moved" or graph.samples:
                made += [(name, moved), (f"{name}_slope", ca.vec(ca.jacobian(moved, x).T))]
        for k, output in enumerate(process.outputs):
            reading = graph.read(x, output.name)
            made += [(f"read_{k}", reading), (f"read_slope_{k}", ca.gradient(reading, x))]
        first = SX.sym("first", 2 + len(model.circuits))
        found: list[tuple[str, GraphFunction, tuple[str, ...]]]
        found = [("begun", GraphFunction([first], graph.begun(first)), ("first",))]
        found += [(name, GraphFunction([x, u], value), ("x", "u")) for name, value in made]
    # The simulator takes the voltages that amplifiers give
    circuits = [replace(one, drive=Drive()) if one.drive.kind == "current" else one for one in model.circuits]
    fed = replace(model, circuits=tuple(circuits))
    with building():
        x, u = SX.sym("x", model.order), SX.sym("u", len(model.circuits))
        step = fed.sample_step.step(x, u, model.sample_time_s / Plant(model).steps, driven=True)[0]
        found.append(("plant_step", GraphFunction([x, u], step), ("x", "u")))
    return found


def _plain(values: Any) -> str:
    return f"[{', '.join(map(_number, values))}]"


def _number(value: float) -> str:
    return repr(float(value)) if np.isfinite(value) else "math.inf" if value > 0.0 else "-math.inf"


@cache
def _templates() -> Environment:
    environment = Environment(  # noqa: S701  no markup
        loader=PackageLoader("femfit.targets", "."), undefined=StrictUndefined, keep_trailing_newline=True
    )
    environment.filters["identifier"] = lambda name: re.sub(r"\W", "_", name).upper()
    return environment


def rendered(template: str, words: dict[str, Any]) -> str:
    """A template of this room with its words."""
    return _templates().get_template(template).render(words)


def estimator_text(words: dict[str, Any]) -> str:
    """The file's text from :func:`words_of`."""
    return rendered(f"{FILE}.jinja", words)
