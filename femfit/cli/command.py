"""What every command has: a check of what it may replace, its results written and printed, options of tables.

A command's signature says which of its paths are files that it writes, and of which kind: ``Annotated[Path | None,
Writes(PAGE)]``. Every other path is one that it reads.
"""

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, is_dataclass
from functools import update_wrapper
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from cyclopts import Parameter
from cyclopts.validators import Number

from femfit import __version__
from femfit.core.errors import UsageError
from femfit.core.files import RESULT, Kind, require_outputs, write_json
from femfit.core.text import counted

if TYPE_CHECKING:
    from femfit.tables.measurement import Measurement

Value = TypeVar("Value")

OUTPUT = Parameter(name=["--output", "-o"])
POSITIVE, NOT_NEGATIVE = Parameter(validator=Number(gt=0.0)), Parameter(validator=Number(gte=0.0))
AT_LEAST_ONE = Parameter(validator=Number(gte=1))
REPEATED = Parameter(show_default=False)

MOST_LINES = 13
"""Conventional: lines that a hurried reader reads, the answer and twelve."""

_ALWAYS = ("written: ", "Next: femfit ")
"""How a line begins that is printed wherever it stands."""

ToWrite = tuple[Path | None, Callable[[Path], object]]
"""Where a file was asked for, and what writes it."""


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
    default : function
        The path where the option is not given, of the command's other arguments.
    """

    kind: Kind | Callable[[Mapping[str, Any]], Kind] | None = None
    name: str = ""
    default: Callable[[Mapping[str, Any]], Path] | None = None


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


def command(json: str = "File for the result as JSON.") -> Callable[[Callable[..., Outcome]], Callable[..., None]]:
    """Give a function that returns its outcome the options ``--json``, whose help is given, and ``--verbose``."""

    def decorate(function: Callable[..., Outcome]) -> Callable[..., None]:
        signature = inspect.signature(function)

        def run(
            *arguments: Any,
            json: Annotated[Path | None, Parameter(help=json)] = None,
            verbose: Annotated[bool, Parameter(help=f"All lines of the result, not {MOST_LINES} at most.")] = False,
            **options: Any,
        ) -> None:
            call = signature.bind(*arguments, **options)
            call.apply_defaults()
            inputs, outputs = _paths(signature, call.arguments)
            require_outputs(inputs, *outputs, (json, RESULT))
            _conclude(function(*call.args, **call.kwargs), json, verbose=verbose)

        own = inspect.signature(run).parameters
        shown = signature.replace(parameters=[*signature.parameters.values(), own["json"], own["verbose"]])
        update_wrapper(run, function)
        run.__signature__ = shown  # type: ignore[attr-defined]
        run.__annotations__ = {name: parameter.annotation for name, parameter in shown.parameters.items()}
        return run

    return decorate


def run_directory(drawing: str, end: str = "") -> Callable[[Mapping[str, Any]], Path]:
    """The default of a directory: ``runs/NAME`` of the drawing that is an argument of this name."""

    def default(arguments: Mapping[str, Any]) -> Path:
        from femfit.device.rewrite import read_variants

        return Path("runs") / f"{read_variants(arguments[drawing]).actuator.name}{end}"

    return default


def _shortened(text: str) -> str:
    """Its first lines, which do not end on a heading, how many more there are, and the files that it names."""
    lines, named = ([x for x in text.splitlines() if x.startswith(_ALWAYS) is kept] for kept in (False, True))
    if len(lines) <= MOST_LINES:
        return text
    depth, count = [len(line) - len(line.lstrip()) for line in lines], MOST_LINES
    while not lines[count - 1] or depth[count] > depth[count - 1]:
        count -= 1
    more = counted(sum(map(bool, lines[count:])), "more line")
    return "\n".join([*lines[:count], f"{more} with --verbose.", *named])


def _conclude(outcome: Outcome, json: Path | None, *, verbose: bool) -> None:
    written = []
    try:
        if json is not None:
            data = outcome.result.to_dict() if outcome.data is None else outcome.data  # type: ignore[attr-defined]
            write_json(json, {**data, "written_by": f"femfit {__version__}"})
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


def _paths(
    signature: inspect.Signature, arguments: dict[str, Any]
) -> tuple[list[Path], list[tuple[Path | None, Kind | None]]]:
    """Paths that are read, those of groups of options too, and files that are written, defaults filled in."""
    read: list[Path] = []
    outputs: list[tuple[Path | None, Kind | None]] = []
    for name, parameter in signature.parameters.items():
        metadata = getattr(parameter.annotation, "__metadata__", ())
        written = [entry for entry in metadata if isinstance(entry, Writes)]
        for writes in written:
            if arguments[name] is None and writes.default is not None:
                arguments[name] = writes.default(arguments)
            if arguments[name] is not None and writes.kind is not None:
                kind = writes.kind if isinstance(writes.kind, Kind) else writes.kind(arguments)
                outputs.append((arguments[name] / writes.name, kind))
        if not written:
            value = arguments[name]
            group = vars(value).values() if is_dataclass(value) else value if isinstance(value, tuple) else (value,)
            read += [path for path in group if isinstance(path, Path)]
    return read, outputs


_TO_SI = {"_mm": ("_m", 1e-3), "_um": ("_m", 1e-6), "_ms": ("_s", 1e-3), "_uV": ("_V", 1e-6), "_g": ("_kg", 1e-3)}


def in_si(options: object) -> dict[str, Any]:
    """A group of options as keywords of the library: what is given in mm, um, ms, uV or g becomes SI, name and all."""
    keywords = {}
    for name, value in vars(options).items():
        stem, mark, unit = name.rpartition("_")
        si, factor = _TO_SI.get(mark + unit, (mark + unit, None))
        keywords[stem + si] = value if value is None or factor is None else factor * value
    return keywords


def names_of(text: str | None) -> tuple[str, ...]:
    """Names with commas between them."""
    return tuple(name for part in (text or "").split(",") if (name := part.strip()))


def parsed(text: str, option: str, form: str, example: str, value_of: Callable[[str], Value]) -> Value:
    """The value of an option's text; a ValueError of ``value_of`` is a wrong use of the option."""
    try:
        return value_of(text)
    except ValueError as error:
        raise UsageError(f"{option} must read {form}, as in {example}; instead received {text!r}.") from error


def pairs(
    texts: Iterable[str], option: str, form: str, example: str, value_of: Callable[[str], Value]
) -> dict[str, Value]:
    """What an option gives as NAME=VALUE, by name."""

    def pair(text: str) -> tuple[str, Value]:
        name, _, value = (part.strip() for part in text.rpartition("="))
        if not (name and value):
            raise ValueError(text)
        return name, value_of(value)

    return dict(parsed(text, option, form, example, pair) for text in texts)


@Parameter(name="*")
@dataclass(frozen=True)
class TableOptions:
    """What a table's columns are, where their headers do not say it.

    Attributes
    ----------
    column : tuple of str
        Column of a header as HEADER=COLUMN, for example "Kanal 3=force_N"; may be repeated.
    unit : tuple of str
        Unit of a header as HEADER=UNIT (Kraft=gf), or HEADER=FACTOR to SI; may be repeated.
    table : str
        Sheet, group or struct of a file that holds several tables (XLSX, MAT, HDF5, TDMS).
    """

    column: Annotated[tuple[str, ...], REPEATED] = ()
    unit: Annotated[tuple[str, ...], REPEATED] = ()
    table: Annotated[str | None, Parameter(show_default=False)] = None

    @property
    def keywords(self) -> dict[str, Any]:
        """All of them, as the functions that read tables take them."""
        return {
            "columns": pairs(self.column, "--column", "HEADER=COLUMN", "Kraft=force_N", str),
            "units": pairs(self.unit, "--unit", "HEADER=UNIT", "Kraft=mN", str),
            "table": self.table,
        }


@Parameter(name="*")
@dataclass(frozen=True)
class MeasurementOptions(TableOptions):
    """What a measurement's columns are, and how large their noise is.

    Attributes
    ----------
    noise : tuple of str
        Noise of one reading as CHANNEL=STANDARD DEVIATION (force_N=2e-4), which counts before the sidecar's.
    setting : tuple of str
        Setting without a column that was the same throughout, as COLUMN=NUMBER in any unit (distance_mm=2).
    """

    noise: Annotated[tuple[str, ...], REPEATED] = ()
    setting: Annotated[tuple[str, ...], REPEATED] = ()

    def read(self, path: Path) -> "Measurement":
        """A bench table or a record over time, as its sidecar and these options say."""
        from femfit.tables.measurement_file import read_measurement

        return read_measurement(path, **self.keywords)

    @property
    def keywords(self) -> dict[str, Any]:
        """All of them, as the functions that read measurements take them."""
        noise = pairs(self.noise, "--noise", "CHANNEL=NUMBER", "force_N=2e-4", float)
        settings = pairs(self.setting, "--setting", "COLUMN=NUMBER", "distance_mm=2", float)
        return {**super().keywords, "noise": noise, "settings": settings}


NO_TABLE_OPTIONS = TableOptions()
NO_MEASUREMENT_OPTIONS = MeasurementOptions()
