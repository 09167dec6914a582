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
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from os.path import realpath
from pathlib import Path
from typing import Any

from femfit.core.errors import OutputError, UsageError


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
    if target.is_symlink():  # a link that could be followed is resolved by now
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
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
    """Write strict JSON, whole or not at all; its directory is made, and what is no finite number is null."""
    write_text(path, json.dumps(json_ready(data), indent=1, allow_nan=False) + "\n")


def json_ready(value: Any) -> Any:
    """Tuples as lists, and NaN and infinity, which JSON does not have, as null."""
    if isinstance(value, Mapping):
        return {key: json_ready(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


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


MODEL, FIELD_MODEL, RESULT, MANIFEST = "a model file", "a field model", "a JSON result", "the manifest of a sweep"
RAW_SIDECAR, NOTES, DRAWING, FEMM = "a raw record's sidecar", "a table's sidecar", "an actuator file", "a FEMM model"
TABLE, PARQUET, RAW = "a table", "a Parquet table", "a binary record"
SWEEP, BENCH = "a sweep table of femfit", "a bench table of femfit"
INTEGRATED, LOOP = "an integrated record of femfit", "a simulated loop's record"
OPEN_LOOP, REPLAYED = "a simulated motion's record", "a record with estimates"
PAGE, PICTURE, PARAVIEW, TEXT = "an HTML page", "a picture", "a ParaView file", "a text"

_BY_SUFFIX = {
    ".csv": TABLE,
    ".parquet": PARQUET,
    ".json": RESULT,
    ".html": PAGE,
    ".vtu": PARAVIEW,
    **dict.fromkeys((".png", ".svg", ".pdf"), PICTURE),
    **dict.fromkeys((".bin", ".raw", ".f32"), RAW),
}
_SUFFIXES = {
    **dict.fromkeys((MODEL, FIELD_MODEL, RESULT, MANIFEST), (".json",)),
    **dict.fromkeys((NOTES, DRAWING), (".toml",)),
    **dict.fromkeys((BENCH, LOOP, REPLAYED), (".csv",)),
    PAGE: (".html", ".htm"),
}
"""Kinds that are written in one format, and the suffixes that say so."""

_OTHER_FORMATS = {".xlsx", ".xls", ".ods", ".mat", ".h5", ".hdf5", ".npz", ".toml", ".xml", ".fem", ".docx"}

_BY_START = ((PARQUET, b"PAR1"), (PICTURE, (b"\x89PNG", b"%PDF")))
_BY_MARK = (
    (PAGE, (b"<!doctype html", b"<html")),
    (PARAVIEW, (b"<vtkfile",)),
    (PICTURE, (b"<svg",)),
    (FEMM, (b"[format]",)),
)
_OWN_COLUMNS = {
    LOOP: b"estimated_distance_m",
    INTEGRATED: b"offset_v",
    OPEN_LOOP: b"static_force_n",
    REPLAYED: b"_innovation_",
}
"""Columns that only tables of femfit have: of simulate, observe and integrate, in lower case."""

_OF_COLUMNS = (TABLE, PARQUET, RAW, RAW_SIDECAR)
_NAMES = 2**16
"""Bytes at the begin, and at the end, of a file in which its columns' names stand."""

_OWN_TEXT = {
    RESULT: (b'"written_by": "femfit',),
    PAGE: (b'name="generator" content="femfit"',),
    NOTES: (b'notes = "flux linkage integrated from the coil voltage',),
    DRAWING: (b"# imported from the femm model", b"# calibrated by femfit from"),
}
"""What stands in a file of this kind that femfit wrote, in lower case."""

_DRAWN = {"fixed", "moving", "coil", "electromagnet", "sweep", "materials"}
_LARGEST_TEXT = 2**24
"""Bytes up to which a text is parsed to tell what it is; femfit writes no larger JSON or TOML."""


def require_outputs(inputs: Iterable[Path | None], *outputs: tuple[Path | None, str | None]) -> None:
    """Refuse outputs that would replace an input, each other or a file of another kind, or are named as another format.

    A path of None stands for an option that was not given, a kind of None for that of the file's suffix.
    """
    read = {realpath(path) for path in inputs if path is not None}  # of a link to itself, too
    written: set[str] = set()
    for path, kind in outputs:
        if path is None or (path.exists() and not path.is_file() and not path.is_dir()):
            continue
        place = realpath(path)
        if place in read:
            raise OutputError(f"{path} is what this command reads; its result would replace it. Choose another name.")
        if place in written:
            raise OutputError(f"{path} is to hold two results of this command. Give each a name of its own.")
        written.add(place)
        if path.is_dir():
            raise OutputError(f"{path} is a directory, where a file is to be written. Give a file's name.")
        _require_suffix(path, kind)
        wanted = kind or _BY_SUFFIX.get(path.suffix.lower(), TEXT)
        if columns := kind in (SWEEP, BENCH, INTEGRATED, LOOP, OPEN_LOOP, REPLAYED):
            by_suffix = _BY_SUFFIX.get(path.suffix.lower())
            wanted = by_suffix if by_suffix in (TABLE, PARQUET, RAW) else TABLE
        present = kind_of(path)
        if present not in (None, wanted):
            raise OutputError(
                f"{path} holds {present}, and {wanted} would replace it. Choose another name, or delete that file."
            )
        table_kind = _own_table(path, present) if present in _OF_COLUMNS else None
        if table_kind and columns and table_kind != kind:
            raise OutputError(
                f"{path} holds {table_kind}, and {kind} would replace it. Choose another name, or delete that file."
            )
        if present is not None and table_kind is None and not _is_own(path, present):
            raise OutputError(f"{path} was not written by femfit. Choose another name, or delete that file.")


def _require_suffix(path: Path, kind: str | None) -> None:
    """Refuse a name that promises another format than the one that is written."""
    fitting, suffix = _SUFFIXES.get(kind or "", ()), path.suffix.lower()
    if fitting and suffix not in fitting and suffix in {*_BY_SUFFIX, *_OTHER_FORMATS}:
        raise OutputError(
            f"{path} is to hold {kind}, which is not written as {suffix}. Give a name that ends in {fitting[0]}."
        )


def kind_of(path: Path) -> str | None:
    """What a file holds; None where there is none, or an empty one."""
    if not path.is_file() or path.stat().st_size == 0:
        return None
    with path.open("rb") as file:
        head = file.read(4096)
    for kind, starts in _BY_START:
        if head.startswith(starts):
            return kind
    start = head.lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    for kind, marks in _BY_MARK:
        if any(mark in start for mark in marks):
            return kind
    binary = any(byte < 9 for byte in head) and not head.startswith((b"\xff\xfe", b"\xfe\xff"))  # UTF-16 has zeros
    return RAW if binary else _kind_of_text(path, start)


def _is_own(path: Path, kind: str) -> bool:
    """Whether femfit wrote a file; true for kinds that nothing else writes, or that are drawn again at any time."""
    if kind in _OF_COLUMNS:
        return _own_table(path, kind) is not None
    text = path.read_bytes().lower() if kind in _OWN_TEXT else b""
    return kind not in _OWN_TEXT or any(mark in text for mark in _OWN_TEXT[kind])


def _own_table(path: Path, kind: str | None) -> str | None:
    """Which of femfit's tables a table is; None for a table of somebody else."""
    notes, manifest = path.with_suffix(".toml"), path.with_name("manifest.json")
    if path.stem == "sweep" and manifest.is_file():
        return SWEEP
    if kind_of(notes) == NOTES and _is_own(notes, NOTES):
        return BENCH
    named = path.with_suffix(".json") if kind == RAW else path  # columns stand in a raw record's sidecar
    if not named.is_file():
        return None
    with named.open("rb") as file:
        names = file.read(_NAMES)
        file.seek(-min(_NAMES, named.stat().st_size), os.SEEK_END)  # where Parquet has them
        names = (names.split(b"\n")[0] if kind == TABLE else names + file.read()).lower()
    return next((table_kind for table_kind, column in _OWN_COLUMNS.items() if column in names), None)


def _kind_of_text(path: Path, start: bytes) -> str:
    if path.stat().st_size <= _LARGEST_TEXT and (start.startswith(b"{") or path.suffix.lower() == ".toml"):
        text = path.read_bytes().decode("utf-8", "replace")
        try:
            if start.startswith(b"{"):
                return _kind_of_json(json.loads(text), path.name)
            return DRAWING if _DRAWN & set(tomllib.loads(text)) else NOTES
        except (ValueError, RecursionError):
            return TEXT
    first = start.splitlines()[0] if start else b""
    return TABLE if any(mark in first for mark in (b",", b";", b"\t")) else TEXT


def _kind_of_json(data: dict[str, Any], name: str) -> str:
    if {"magnetics", "validity"} <= data.keys():
        return MODEL
    if "coefficients_T" in data:
        return FIELD_MODEL
    if "sample_rate_Hz" in data:
        return RAW_SIDECAR
    return MANIFEST if name == "manifest.json" else RESULT
