"""What every command has: a check of what it may replace, and its results written and printed.

A command's signature says which of its paths are files that it writes, and of which kind: ``Annotated[Path | None,
Writes(PAGE)]``. Every other path is one that it reads.
"""

import inspect
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial, update_wrapper
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from cyclopts import Parameter
from cyclopts.validators import Number

import femfit as ff
from femfit.cli.keywords import Keywords
from femfit.core.files import PAGE, PICTURE, REPLAYED, RESULT, Kind, require_outputs, write_json, write_text
from femfit.core.text import counted

OUTPUT = Parameter(name=["--output", "-o"])
AT_LEAST_ONE, NOT_NEGATIVE = Parameter(validator=Number(gte=1)), Parameter(validator=Number(gte=0))

Arguments = Mapping[str, Any]
"""Of a command, by their names."""

MOST_LINES = 13
"""Conventional: lines that a hurried reader reads, the answer and twelve."""

_VERBOSE = inspect.Parameter(
    "verbose",
    inspect.Parameter.KEYWORD_ONLY,
    default=False,
    annotation=Annotated[bool, Parameter(help=f"All lines of the result, not {MOST_LINES} at most.")],
)

_ALWAYS = ("written: ", "Next: femfit ")
"""How a line begins that is printed wherever it stands."""

ToWrite = tuple[Path | None, Callable[[Path], object]]
"""Where a file was asked for, and what writes it."""


@dataclass(frozen=True)
class Default:
    """What a parameter of a command is where its option is not given, made of the other arguments."""

    make: Callable[[Arguments], Any]


Cores = Annotated[int, AT_LEAST_ONE, Default(lambda _: len(os.sched_getaffinity(0)))]
"""Number of processes, one a core by default."""


@dataclass(frozen=True)
class Writes:
    """A path of a command's signature is one that it writes.

    Attributes
    ----------
    kind : Kind or function
        Of the file, as in :mod:`femfit.core.files`, or what gives it of the command's arguments; without one,
        what is written there looks after itself.
    name : str
        Name of the file in the directory that the option names.
    """

    kind: Kind | Callable[[Arguments], Kind] | None = None
    name: str = ""


def _picture(result: Any, path: Path) -> None:
    from femfit.report.style import write_picture

    write_picture(result.plot, path)


_FILES: dict[str, tuple[Kind, Callable[[Any, Path], object]]] = {
    "picture": (PICTURE, _picture),
    "csv": (REPLAYED, lambda result, path: write_text(path, result.table.to_csv(index=False))),
    "report": (PAGE, lambda result, path: ff.write_report(result, path)),  # noqa: PLW0108  loaded when used
}
"""Options for files that a result can be written to, whatever it is: their kind, and what writes them."""


@dataclass(frozen=True)
class Outcome:
    """What a command ends with.

    Attributes
    ----------
    result : object
        What is printed.
    data : mapping
        The same as JSON; by default the result's own ``to_dict()``.
    files : sequence
        Files that are written before the result is printed, and named after it.
    error : BaseException
        Raised when all is written and printed.
    """

    result: object
    data: Mapping[str, Any] | None = None
    files: Sequence[ToWrite] = ()
    error: BaseException | None = None


def command(
    json: str = "File for the result as JSON.", **files: str
) -> Callable[[Callable[..., Outcome]], Callable[..., None]]:
    """Give a function that returns its outcome the options ``--json`` and ``--verbose``, and others for its files.

    Parameters
    ----------
    json : str
        Help of ``--json``.
    files : str
        Help of ``--picture``, ``--csv`` and ``--report``, by their names, where the result is written to such files.
    """
    texts = {**files, "json": json}

    def decorate(function: Callable[..., Outcome]) -> Callable[..., None]:
        signature = inspect.signature(function)
        keywords, defaults = dict(_marks(signature, Keywords)), dict(_marks(signature, Default))

        def run(*arguments: Any, **options: Any) -> None:
            from femfit.core.processes import kept_interrupts

            verbose, paths = options.pop("verbose", False), {name: options.pop(name, None) for name in texts}
            options |= {name: mark.arguments(options) for name, mark in keywords.items()}
            call = signature.bind(*arguments, **dict.fromkeys(defaults) | options)
            call.apply_defaults()
            missing = {name: default for name, default in defaults.items() if call.arguments[name] is None}
            call.arguments |= {name: default.make(call.arguments) for name, default in missing.items()}
            inputs, outputs = _paths(signature, call.arguments)
            outputs += [(paths[name], _FILES[name][0]) for name in files]
            require_outputs(inputs, *outputs, (paths["json"], RESULT))
            with kept_interrupts():
                outcome = function(*call.args, **call.kwargs)
                more = [(paths[name], partial(_FILES[name][1], outcome.result)) for name in files]
                _conclude(replace(outcome, files=[*outcome.files, *more]), paths["json"], verbose=verbose)

        shown: list[inspect.Parameter] = []
        for name, parameter in signature.parameters.items():
            if name in keywords:
                shown += [entry.parameter for entry in keywords[name].entries]
            elif name in defaults:
                kind, *marks = get_args(parameter.annotation)
                shown.append(parameter.replace(default=None, annotation=Annotated[kind | None, *marks]))
            else:
                shown.append(parameter)
        for name, text in texts.items():
            annotation = Annotated[Path | None, Parameter(help=text)]
            shown.append(_VERBOSE.replace(name=name, default=None, annotation=annotation))
        shown.append(_VERBOSE)
        update_wrapper(run, function)
        run.__signature__ = signature.replace(parameters=shown)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in shown}
        return run

    return decorate


def run_directory(drawing: str, end: str = "") -> Callable[[Arguments], Path]:
    """``runs/NAME`` of the drawing that is an argument of this name."""

    def default(arguments: Arguments) -> Path:
        from femfit.device.rewrite import read_variants

        return Path("runs") / f"{read_variants(arguments[drawing]).actuator.name}{end}"

    return default


def _shortened(text: str) -> str:
    """Its first lines, which do not end on a heading, how many more there are, and the files that it names."""
    lines = [line for line in text.splitlines() if not line.startswith(_ALWAYS)]
    if len(lines) <= MOST_LINES:
        return text
    depth, count = [len(line) - len(line.lstrip()) for line in lines], MOST_LINES
    while not lines[count - 1] or depth[count] > depth[count - 1]:
        count -= 1
    more = counted(sum(map(bool, lines[count:])), "more line")
    named = (line for line in text.splitlines() if line.startswith(_ALWAYS))
    return "\n".join([*lines[:count], f"{more} with --verbose.", *named])


def _conclude(outcome: Outcome, json: Path | None, *, verbose: bool) -> None:
    written = []
    try:
        if json is not None:
            data = outcome.result.to_dict() if outcome.data is None else outcome.data  # type: ignore[attr-defined]
            write_json(json, {**data, "written_by": f"femfit {ff.__version__}"})
        for path, write in outcome.files:
            if path is not None:
                write(path)
                written.append(f"written: {path}")
    finally:  # what was found is told even where a file of it cannot be written
        text = str(outcome.result)
        with suppress(BrokenPipeError):  # of a reader who has seen enough: what is left to do is done
            # An error sends its reader to the lines above it
            print(text if verbose or outcome.error else _shortened(text), *written, sep="\n")
    if outcome.error is not None:
        raise outcome.error


Mark = TypeVar("Mark")


def _marks(signature: inspect.Signature, kind: type[Mark]) -> list[tuple[str, Mark]]:
    """The parameters whose annotation has such marks, once with each."""
    annotations = ((name, parameter.annotation) for name, parameter in signature.parameters.items())
    marks = ((name, mark) for name, annotation in annotations for mark in getattr(annotation, "__metadata__", ()))
    return [(name, mark) for name, mark in marks if isinstance(mark, kind)]


def _paths(
    signature: inspect.Signature, arguments: Arguments
) -> tuple[list[Path], list[tuple[Path | None, Kind | None]]]:
    """Paths that are read, those of keywords too, and files that are written."""
    written = _marks(signature, Writes)
    outputs: list[tuple[Path | None, Kind | None]] = []
    for name, writes in written:
        if arguments[name] is not None and writes.kind is not None:
            kind = writes.kind if isinstance(writes.kind, Kind) else writes.kind(arguments)
            outputs.append((arguments[name] / writes.name, kind))
    read: list[Any] = [value for name, value in arguments.items() if name not in dict(written)]
    several = (value.values() if isinstance(value, dict) else value for value in read)
    flat = (path for v in several for path in (v if isinstance(v, Iterable) else (v,)))
    return [path for path in flat if isinstance(path, Path)], outputs


_READ, _WORDS = "read_measurement", "columns=column units=unit table"

TableOptions = Annotated[dict[str, Any], Keywords(_READ, _WORDS)]
"""What a table's columns are, where their headers do not say it."""

MeasurementOptions = Annotated[dict[str, Any], Keywords(_READ, f"{_WORDS} noise settings=setting")]
"""What a measurement's columns are, and how large their noise is."""
