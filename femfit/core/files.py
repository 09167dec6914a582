"""Files: their paths, how they are written whole or not at all, and which ones a command may replace.

What is written goes to a file beside the target and takes its place when it is complete: a kill, a full disk or an
error in between leaves an earlier file of that name as it was.

A command never writes to a file that it reads, nor to a file of another kind. An earlier result of femfit is replaced;
JSON, pages, tables and sidecars that femfit did not write are not. What an existing file is, is told by its content,
not by its name: a drawing that lies where a bench table's sidecar would go stays.
"""

import errno
import json
import math
import os
import secrets
import stat
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from femfit.core.errors import FemfitError, OutputError, TableError, UsageError
from femfit.core.results import json_ready
from femfit.core.text import quoted


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a file to write to, which replaces ``path`` when the block ends without an error.

    The file has the target's suffix, because many writers choose their format by it. A symbolic link stays one: the
    file that it points to is replaced. A device such as ``/dev/stdout`` is written to directly.

    Examples
    --------
    >>> with replacing("runs/table.csv") as partial:  # doctest: +SKIP
    ...     rows.to_csv(partial)
    """
    target = Path(os.path.realpath(path))
    device = Path(path).exists() and not Path(path).is_file() and not target.is_dir()
    # A name that nobody can foresee, of a file that must be new: a link laid in its place would be written through
    name = f".{target.stem[:40]}.{secrets.token_hex(8)}.partial{target.suffix}"
    # A pipe behind /dev/stdout has no path of its own
    partial = Path(path) if device else target.parent / name
    try:
        if device:
            yield partial
            return
        mode = _prepare(path, target, partial)
        yield partial
        if mode is not None:
            partial.chmod(mode)
        partial.replace(target)
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(partial), partial):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        if not device:
            with suppress(OSError):  # what cannot be made cannot be removed, and the first error says why
                partial.unlink(missing_ok=True)


def _prepare(path: str | Path, target: Path, partial: Path) -> int | None:
    """Make the file that is written to; return the permissions of the one that it replaces, if there is one."""
    if target.is_dir() or str(path).endswith(os.sep):
        raise IsADirectoryError(errno.EISDIR, "Is a directory, where a file is to be written", str(path))
    target.parent.mkdir(parents=True, exist_ok=True)
    mode = stat.S_IMODE(target.stat().st_mode) if target.exists() else None
    # Less what the umask denies; what replaces a secret is one before it is complete
    os.close(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666 if mode is None else 0o600))
    return mode


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, whole or not at all; its directory is made."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def write_json(path: str | Path, data: Mapping[str, Any]) -> None:
    """Write strict JSON, whole or not at all; its directory is made. Results and other records may be in it."""
    write_text(path, json.dumps(json_ready(data), indent=1, allow_nan=False) + "\n")


def path_of(value: object, what: str) -> Path:
    """Make a path of a text or a path; anything else is a UsageError that says ``what`` it was to be.

    Examples
    --------
    >>> path_of("runs/rig", "A run directory").name
    'rig'
    """
    if not isinstance(value, str | Path):
        raise UsageError(
            f"{what} must be given as a path, a str or a Path; instead received {type(value).__name__}. Give where the "
            "file is."
        )
    return Path(value)


class Kind(NamedTuple):
    """A kind of file that femfit writes."""

    words: str
    suffixes: tuple[str, ...] = ()  # Of one that is written in one format
    # What stands at the begin or at the end of one that femfit wrote, in lower case; of tables, a column of its own
    marks: tuple[bytes, ...] = ()


MODEL = Kind("a model file", (".json",), (b'"magnetics":',))
RESULT = Kind("a JSON result", (".json",), (b'"written_by": "femfit',))
MANIFEST = Kind("the manifest of a sweep", (".json",), (b"{",))
NOTES = Kind("a table's sidecar", (".toml",), (b'notes = "flux linkage integrated from the coil voltage',))
DRAWING = Kind("an actuator file", (".toml",), (b"# imported from the femm model", b"# calibrated by femfit from"))
SWEEP = Kind("a sweep table")
BENCH = Kind("a bench table", (".csv",))
LOOP = Kind("a simulated loop's record", (".csv",), (b"estimated_distance_m",))
INTEGRATED = Kind("an integrated record", (), (b"offset_v",))
OPEN_LOOP = Kind("a simulated motion's record", (), (b"static_force_n",))
REPLAYED = Kind("a record with estimates", (".csv",), (b"_innovation_", b"claimed_m,bound_m"))
PAGE = Kind("an HTML page", (".html", ".htm"), (b'name="generator" content="femfit"',))
PICTURE = Kind("a picture", (".png", ".svg", ".pdf"), (b"\x89png", b"%pdf", b"<svg"))
PARAVIEW = Kind("a ParaView file", (), (b"<vtkfile",))

_TABLE = Kind("a table", (), tuple(mark for kind in (LOOP, INTEGRATED, OPEN_LOOP, REPLAYED) for mark in kind.marks))
_BY_SUFFIX = {
    ".html": PAGE, ".vtu": PARAVIEW, ".json": RESULT, ".csv": _TABLE, ".parquet": _TABLE,
    **dict.fromkeys(PICTURE.suffixes, PICTURE),
}  # fmt: skip
_OTHER = _TABLE._replace(words="a result")
_OTHER_FORMATS = {".xlsx", ".xls", ".ods", ".mat", ".h5", ".hdf5", ".npz", ".toml", ".xml", ".fem", ".docx"}

_MARKED = 2**16
"""Bytes at the begin, and at the end, of a file in which its mark stands: of a Parquet table at the end."""


def require_outputs(inputs: Iterable[Path | None], *outputs: tuple[Path | None, Kind | None]) -> None:
    """Refuse outputs that would replace an input, each other or what femfit did not write as a file of that kind.

    A path of None stands for an option that was not given, a kind of None for that of the file's suffix.
    """
    read = {os.path.realpath(path) for path in inputs if path is not None}  # of a link to itself, too
    written: set[str] = set()
    for path, stated in outputs:
        if path is None or (path.exists() and not path.is_file() and not path.is_dir()):
            continue
        place, suffix = os.path.realpath(path), path.suffix.lower()
        kind = stated or _BY_SUFFIX.get(suffix, _OTHER)
        if place in read:
            raise OutputError(f"{path} is what this command reads; its result would replace it. Choose another name.")
        if place in written:
            raise OutputError(f"{path} is to hold two results of this command. Give each a name of its own.")
        written.add(place)
        if path.is_dir():
            raise OutputError(f"{path} is a directory, where a file is to be written. Give a file's name.")
        if file := next((parent for parent in path.parents if parent.exists() and not parent.is_dir()), None):
            raise OutputError(f"{file} is a file, where a directory is needed. Choose another name.")
        foreign = suffix if kind is PICTURE else suffix in {*_BY_SUFFIX, *_OTHER_FORMATS}
        if kind.suffixes and foreign and suffix not in kind.suffixes:
            raise OutputError(
                f"{path} is to hold {kind.words}, which is not written as {suffix}. Give a name that ends in "
                f"{' or '.join(kind.suffixes)}."
            )
        if path.is_file() and path.stat().st_size and not _is_of(path, kind):
            raise OutputError(
                f"{path} was not written by femfit as {kind.words}, which would replace it. Choose another name, or "
                "delete that file."
            )


def _is_of(path: Path, kind: Kind) -> bool:
    """Whether a file is one of a kind that femfit wrote."""
    if kind is SWEEP:
        return path.stem == "sweep" and path.with_name("manifest.json").is_file()
    if kind is BENCH:
        return _is_of(path.with_suffix(".toml"), NOTES)
    if not path.is_file():
        return False
    with path.open("rb") as file:
        text = file.read(_MARKED)
        file.seek(-min(_MARKED, path.stat().st_size), os.SEEK_END)
        text = (text + file.read()).lower()
    return any(mark in text for mark in kind.marks)


Made = TypeVar("Made")


def write_arrays(arrays: Mapping[str, Any] | None, file: Path) -> None:
    """Write what is not None of them, or remove an earlier file where there are no arrays."""
    if arrays is None:
        file.unlink(missing_ok=True)
        return
    held: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items() if value is not None}
    with replacing(file) as partial, partial.open("wb") as out:
        np.savez_compressed(out, **held)


@contextmanager
def reading(file: object, remedy: str, kind: str = "") -> Iterator[None]:
    """Turn any exception into a TableError, but for femfit's own and for too little memory.

    Libraries raise over damaged files what their authors never thought of: no list of exceptions is complete.
    """
    try:
        yield
    except (FemfitError, MemoryError):
        raise
    except Exception as error:
        reason = quoted(f"{type(error).__name__}: {error}", 300)
        raise TableError(f"{file} cannot be read{kind}; it seems to be damaged ({reason}). {remedy}") from error


def read_arrays(file: Path, make: Callable[[dict[str, Any]], Made], remedy: str) -> Made | None:
    """What is made of a file's arrays; None where there is no file.

    Raises
    ------
    TableError
        If the file is damaged.
    """
    if not file.is_file():
        return None
    with reading(file, remedy), file.open("rb") as source, np.load(source, allow_pickle=False) as held:
        return make({name: held[name] for name in held.files})


def read_settings(file: Path, example: str) -> dict[str, Any]:
    """Read a small TOML or JSON file of settings."""
    try:
        text = file.read_text(encoding="utf-8")
        data = tomllib.loads(text) if file.suffix == ".toml" else json.loads(text, parse_constant=_refuse_constant)
    except (OSError, ValueError, RecursionError) as error:
        kind = "TOML" if file.suffix == ".toml" else "JSON"
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else quoted(error, 200)
        raise TableError(f"{file} must be {kind}, with lines like {example}; {reason}.") from error
    if not isinstance(data, dict):
        raise TableError(f"{file} must hold settings by name, like {example}; instead received {quoted(data)}.")
    return data


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def finite_number(value: object) -> float | None:
    """Return a number of a settings file as a float; None for anything else, and for what a float does not hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    with suppress(OverflowError):
        return float(value) if math.isfinite(value) else None
    return None
