"""Export a model's filter as C99: generated arithmetic, and around it a shell that is written by hand."""

import re
import shutil
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, NamedTuple

import casadi as ca
import numpy as np
import pandas as pd

from femfit.core.errors import DomainError, UsageError
from femfit.core.graph import GraphFunction, building
from femfit.core.text import amount
from femfit.estimate.holding import holding_currents
from femfit.estimate.kalman_filter import FilterKind, kalman_filter
from femfit.estimate.noise import first_deviations
from femfit.estimate.process import FilterProcess
from femfit.estimate.single_step import step_function
from femfit.model.actuator_model import ActuatorModel
from femfit.model.sensors import predict_sensor, reading_of, sensor_named
from femfit.simulation.plant import Plant
from femfit.targets.estimator import rendered, words_of, write_directory
from femfit.targets.splined import splined

Real = Literal["double", "float"]

ARITHMETIC = "femfit_arithmetic.c"

TEMPLATES = ("femfit_model.h", "femfit_filter.c", "replay.c", "Makefile")

_NUMBER = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])")
_CALL = re.compile(
    r"(?<!\w)(exp|expm1|log|log1p|pow|sqrt|sin|cos|tan|atan|atan2|sinh|cosh|tanh|asinh|fabs|fmax|fmin|floor|copysign)\("
)

MISSING = {"double": "1e200", "float": "1e30f"}
"""Numerical: variance of a reading that is missing."""

FLOOR = {"double": 0.0, "float": 1e-6}
"""Numerical: least part of a variance that a factor keeps, a dozen roundings; double precision needs none."""

SAMPLES = 400
"""Chosen: of the simulated motion along which single precision is compared."""

STARTS = (0.0, -1.0, 1.0)
"""Chosen: errors of first distances that it is followed from, over the deviation that the filter expects."""


class SinglePrecision(NamedTuple):
    """How single precision compares with double along a simulated motion, from :data:`STARTS`."""

    difference_m: float  # The largest one between the distances
    lost: int  # Starts from which it loses its covariance, or a number, where double precision does not


_HEAD = """\
/* Written by femfit from its model's equations, by CasADi: not to be read, and not to be edited. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#pragma GCC diagnostic ignored "-Wunused-const-variable"
#endif
"""

_DESCRIBING = re.compile(
    r"^CASADI_SYMBOL_EXPORT [^{}]*?femfit_(?:begun|arithmetic)_\w+\([^{]*\{(?:[^\n]*\}|.*?^\})\n",
    re.MULTILINE | re.DOTALL,
)
"""A function that says of another one how many arguments it has, and of which shape."""


def export_c(
    model: ActuatorModel,
    directory: Path,
    sensors: Sequence[str] | None = None,
    kind: FilterKind = "ukf",
    real: Real = "double",
) -> tuple[tuple[Path, ...], SinglePrecision | None]:
    """Write the filter, a program that follows a record with it, and a description.

    Returns
    -------
    tuple of (paths, SinglePrecision or None)
        The files, and how single precision compares with the model as it is: in single precision a co-energy that
        effects change is splines where these are less work.

    Raises
    ------
    MissingPartError
        If the model lacks circuit, motion, sensor or inductance.
    RunDirectoryError
        If the directory holds other files than an earlier export.
    """
    words = words_of(model, kalman_filter(model, kind, sensors=sensors).process)
    identifiers = [re.sub(r"\W", "_", name).upper() for name in (*words["states"], *words["sensors"])]
    if len(set(identifiers)) < len(identifiers):
        raise UsageError(
            f"Names of sensors must differ in more than case and signs to be names in C; instead received "
            f"{', '.join(words['sensors'])}. Rename one in the model file."
        )
    light, change = splined(model) if real == "float" else (model, 0.0)
    words |= {"change": change and f"{change:.1g}", "difference": "", "lost": 0, "starts": len(STARTS)}
    single = _single_precision(model, light, words, kind, sensors) if real == "float" else None
    if single is not None:
        words |= {"difference": amount(single.difference_m, "m"), "lost": single.lost}
    texts = _texts(light, words, kind, real, sensors)
    return write_directory(model, directory, texts, "femfit_model.h"), single


def _texts(
    model: ActuatorModel, words: dict[str, Any], kind: FilterKind, real: Real, sensors: Sequence[str] | None
) -> dict[str, str]:
    """All files by their names."""
    built = kalman_filter(model, kind, sensors=sensors)
    process, start = built.process, built.process.start_covariance
    source, sizes = _arithmetic(step_function(built, compact=True, floor=FLOOR[real]), process, real)
    size = {"double": 8, "float": 4}[real]
    words = words | {
        "kind": {"ukf": "unscented", "ekf": "extended"}[kind],
        "real": real,
        "suffix": "f" if real == "float" else "",
        "units": [reading_of(model, output.name).unit for output in process.outputs],
        "all_sensors": 2 ** len(process.outputs) - 1,
        "start_covariance": start.ravel(),
        "start_factor": np.linalg.cholesky(start).ravel("F"),
        "missing": MISSING[real],
        "first_states": ", ".join(words["states"][: len(words["first"])]),
        "memory_kB": f"{1e-3 * size * (sizes['work'] + process.order * (2 * process.order + 1)):.1f}",
        **sizes,
    }
    texts = {name: rendered(f"{name}.jinja", words) for name in TEMPLATES}
    return texts | {ARITHMETIC: source, "README.md": rendered("c_readme.md.jinja", words)}


def _arithmetic(function: ca.Function, process: FilterProcess, real: Real) -> tuple[str, dict[str, int]]:
    """The generated source, and how much room it wants."""
    symbols = function.sx_in() if function.is_a("SXFunction") else function.mx_in()
    with building():
        first = ca.SX.sym("first", 2 + process.inputs)
        begun = GraphFunction([first], process.begun(first)).at_a_point
    at_rest = begun.sx_in() if begun.is_a("SXFunction") else begun.mx_in()
    functions = [
        ca.Function("femfit_begun", at_rest, [begun(*at_rest)]),
        ca.Function("femfit_arithmetic", symbols, [function(*symbols)]),
    ]
    options = {"casadi_real": real, "casadi_int": "int", "with_header": False, "indent": 2}
    generator = ca.CodeGenerator("femfit_arithmetic", options)
    for f in functions:
        generator.add(f)
    source = _HEAD + _DESCRIBING.sub("", generator.dump()).replace(" casadi_nan NAN", " casadi_nan ((casadi_real) NAN)")
    if real == "float":  # CasADi leaves constants and functions in double precision
        source = _CALL.sub(r"\1f(", _NUMBER.sub(r"\1f", source)).replace("fmaxf(x, y)", "x > y ? x : y")
    sizes = {
        "arguments": max(5, *(f.sz_arg() for f in functions)),
        "results": max(f.sz_res() for f in functions),
        "work": max(1, *(f.sz_w() for f in functions)),
        "places": max(1, *(f.sz_iw() for f in functions)),
    }
    return source, sizes


def _single_precision(
    model: ActuatorModel, light: ActuatorModel, words: dict[str, Any], kind: FilterKind, sensors: Any
) -> SinglePrecision | None:
    """Both precisions along a motion of the simulator.

    Programs of the model in double precision and of the light one in single are compiled and follow the same records;
    None without a compiler.
    """
    if (compiler := shutil.which("cc")) is None:
        return None
    box, motion, distances, broken = model.validity, _motion(model, words), {}, {}
    first = words["first"][0] + first_deviations(model)[0] * np.array(STARTS)
    first = np.clip(first, box.distance_min_m, box.distance_max_m)
    with TemporaryDirectory() as place:
        records = [Path(place) / f"{k}.csv" for k in range(len(STARTS))]
        for record, begin in zip(records, first, strict=True):
            motion.loc[0, "distance_m"] = begin
            motion.to_csv(record, index=False)
        programs: tuple[tuple[Real, ActuatorModel], ...] = (("double", model), ("float", light))
        for real, modelled in programs:
            directory = Path(place) / real
            directory.mkdir()
            for name, text in _texts(modelled, words, kind, real, sensors).items():
                (directory / name).write_text(text, encoding="utf-8")
            made = [compiler, "-std=c99", "-O1", "-o", "replay", "replay.c", "femfit_filter.c", ARITHMETIC, "-lm"]
            subprocess.run(made, cwd=directory, check=True, capture_output=True)  # noqa: S603  our own files
            runs = [
                subprocess.run([directory / "replay", record], check=True, capture_output=True, text=True)  # noqa: S603
                for record in records
            ]
            distances[real] = [np.loadtxt(run.stdout.splitlines()[1:], delimiter=",")[:, 1] for run in runs]
            broken[real] = np.array(["covariance lost" in run.stderr or "not finite" in run.stderr for run in runs])
    difference = np.abs(np.subtract(distances["double"], distances["float"])).max()
    return SinglePrecision(float(difference), int(np.sum(broken["float"] & ~broken["double"])))


def _motion(model: ActuatorModel, words: dict[str, Any]) -> pd.DataFrame:
    """A record of the simulated actuator under voltages that swing about what holds it, until it leaves the model."""
    plant, box, ohms = Plant(model), model.validity, model.resistances_ohm
    named = [sensor_named(model, name) for name in words["sensors"]]
    distance = words["first"][0]
    held = box.current_limits_A.mean(axis=1)[: len(ohms)]
    with suppress(DomainError):  # what nothing holds swings about the middle of its currents
        held = holding_currents(model, distance)
    state = plant.start(np.array([[distance, 0.0, *held]]))
    rows: list[dict[str, float]] = []
    columns = [*words["states"][: 2 + len(ohms)], "time_s", *words["commands"], *words["reading_columns"]]
    while len(rows) < SAMPLES and box.distance_min_m <= state[0, 0] <= box.distance_max_m:
        volts = ohms * held * (1.0 + 0.02 * np.sin(0.3 * len(rows)))
        readings = [float(predict_sensor(model, sensor, state)[0]) for sensor in named]
        values = [distance, 0.0, *held, len(rows) * model.sample_time_s, *volts, *readings]
        rows.append(dict(zip(columns, values, strict=True)))  # a reading counts before a first state
        state = plant.step(state, volts[None])
    return pd.DataFrame(rows)
