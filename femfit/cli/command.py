"""What every command does around its work: it checks what it may replace, writes its results, and prints them.

A command's signature says which of its paths are files that it writes, and of which kind: ``Annotated[Path | None,
Writes(PAGE)]``. Every other path is one that it reads.
"""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from femfit import __version__
from femfit.core.files import RESULT, require_outputs, write_json

OUTPUT = Parameter(name=["--output", "-o"])

ToWrite = tuple[Path | None, Callable[[Path], object]]
"""Where a file was asked for, and what writes it."""


@dataclass(frozen=True)
class Writes:
    """A path of a command's signature is one that it writes.

    Attributes
    ----------
    kind : str
        Kind of the file, as in :mod:`femfit.core.files`; without one, what is written there looks after itself.
    name : str
        Name of the file in the directory that the option names.
    default : function
        The path where the option is not given, of the command's other arguments.
    """

    kind: str | None = None
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
        Files that are written before anything is printed, and named after the result.
    last : str
        What is printed below their names.
    error : BaseException
        Raised when all is written and printed.
    """

    result: object
    data: Mapping[str, Any] | None = None
    files: Sequence[ToWrite] = ()
    last: str = ""
    error: BaseException | None = None


def command(json: str = "File for the result as JSON.") -> Callable[[Callable[..., Outcome]], Callable[..., None]]:
    """Give a function that returns its outcome the option ``--json``, whose help is given, unless it has its own."""

    def decorate(function: Callable[..., Outcome]) -> Callable[..., None]:
        signature = inspect.signature(function)
        has_json = "json" in signature.parameters
        option = inspect.Parameter(
            "json",
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[Path | None, Parameter(help=json)],
        )
        shown = signature if has_json else signature.replace(parameters=[*signature.parameters.values(), option])

        @wraps(function)
        def run(*arguments: Any, **options: Any) -> None:
            target: Path | None = options.get("json") if has_json else options.pop("json", None)
            call = signature.bind(*arguments, **options)
            call.apply_defaults()
            outputs = list(_outputs(signature, call.arguments))
            require_outputs(_inputs(signature, call.arguments), *outputs, (target, RESULT))
            _conclude(function(*call.args, **call.kwargs), target)

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


def _conclude(outcome: Outcome, json: Path | None) -> None:
    written = [(path, write) for path, write in outcome.files if path is not None]
    for path, write in written:
        write(path)
    if json is not None:
        data = outcome.result.to_dict() if outcome.data is None else outcome.data  # type: ignore[attr-defined]
        write_json(json, {**data, "written_by": f"femfit {__version__}"})
    print(outcome.result, *(f"written: {path}" for path, _ in written), *filter(None, [outcome.last]), sep="\n")
    if outcome.error is not None:
        raise outcome.error


def _written(parameter: inspect.Parameter) -> list[Writes]:
    return [entry for entry in getattr(parameter.annotation, "__metadata__", ()) if isinstance(entry, Writes)]


def _outputs(signature: inspect.Signature, arguments: dict[str, Any]) -> Iterator[tuple[Path | None, str | None]]:
    """Files that are written; an option that was not given gets its default."""
    for name, parameter in signature.parameters.items():
        for writes in _written(parameter):
            if arguments[name] is None and writes.default is not None:
                arguments[name] = writes.default(arguments)
            path = arguments[name]
            if path is not None and writes.kind is not None:
                yield path / writes.name if writes.name else path, writes.kind


def _inputs(signature: inspect.Signature, arguments: Mapping[str, Any]) -> Iterator[Path]:
    """Paths that are read, those of groups of options too."""
    for name, value in arguments.items():
        if _written(signature.parameters[name]) or name == "json":
            continue
        group = vars(value).values() if is_dataclass(value) else value if isinstance(value, tuple) else (value,)
        yield from (path for path in group if isinstance(path, Path))
