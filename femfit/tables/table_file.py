"""The one place that decides how a file of numbers is read: by its first bytes, else as text."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from femfit.core.errors import TableError
from femfit.core.results import listing
from femfit.core.text import quoted
from femfit.tables.raw_table import PARQUET_MAGIC, RawTable, decoding, parse_parquet
from femfit.tables.text_table import parse_text

SUFFIXES = (
    ".csv",
    ".txt",
    ".dat",
    ".tsv",
    ".asc",
    ".parquet",
    ".xlsx",
    ".mat",
    ".h5",
    ".hdf5",
    ".tdms",
    ".wav",
)
"""What is taken for a table where a directory is read."""

_HDF5 = b"\x89HDF\r\n\x1a\n"
Wanted = Callable[[RawTable], bool]
Reader = Callable[[bytes, str], tuple[list[RawTable], str]]


def parse_table(
    content: bytes,
    source: str,
    *,
    table: str | None = None,
    wanted: Wanted | None = None,
    **dialect: str | None,
) -> RawTable:
    """Read a table of any kind of file; the dialect is that of :func:`femfit.tables.text_table.parse_text`.

    Parameters
    ----------
    table : str, optional
        Which of a file's tables: a sheet, a group, a struct.
    wanted : callable, optional
        Whether a table has the columns that are needed; of several tables the only one that has them is taken.

    Raises
    ------
    TableError
        If it is damaged, or if no or more than one of several tables has what is needed.
    """
    kind = container_kind(content, source)
    if kind is not None:
        return _chosen(kind, content, source, table, wanted)
    if table is not None:
        raise TableError(f"{source} holds one table, so that --table {quoted(table)} has no meaning. Leave it out.")
    if content.startswith(PARQUET_MAGIC) or source.endswith(".parquet"):
        return parse_parquet(content, source)
    return parse_text(content, source, **dialect)


def container_kind(content: bytes, source: str) -> str | None:
    """Name the kind of a file that may hold several tables, by its first bytes; None for text and Parquet."""
    matlab = source.casefold().endswith(".mat")
    if content.startswith(_HDF5):
        return "HDF5"
    if content.startswith(b"MATLAB 7.3") or (matlab and content[512:520] == _HDF5):
        return "MAT 7.3"
    signs = {
        "MAT": matlab or content.startswith(b"MATLAB 5.0"),
        "XLSX": content.startswith(b"PK\x03\x04") and b"xl/" in content,
        "TDMS": content.startswith(b"TDSm"),
        "WAV": content[:4] in {b"RIFF", b"RIFX", b"RF64"} and content[8:12] == b"WAVE",
    }
    return next((kind for kind, sign in signs.items() if sign), None)


def is_container(path: Path) -> bool:
    """Tell whether a file is of a kind that may hold several tables, without reading it whole."""
    with path.open("rb") as file:
        head = file.read(1024)
    return head.startswith(b"PK\x03\x04") or container_kind(head, path.name) is not None


def _chosen(kind: str, content: bytes, source: str, table: str | None, wanted: Wanted | None) -> RawTable:
    """The table of a file that is asked for, or the only one that has what is needed."""
    from femfit.tables import containers  # noqa: PLC0415  its libraries load when it is used

    readers: dict[str, Reader] = {
        "XLSX": containers.read_xlsx,
        "TDMS": containers.read_tdms,
        "WAV": containers.read_wav,
    }
    reader = readers.get(kind, partial(containers.read_apart, kind))
    with decoding(source, kind), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a file's styles, titles or index, which no number depends on
        tables, remark = reader(content, source)
    suitable = _named(tables, table) if table is not None else tables
    if table is None and len(tables) > 1:
        suitable = [candidate for candidate in tables if wanted is None or wanted(candidate)]
    if len(suitable) == 1:
        raw = suitable[0]
        if table is not None or len(tables) == 1:
            return raw
        passed_over = listing(candidate.name for candidate in tables if candidate is not raw)
        note = f"of {len(tables)} tables {quoted(raw.name)!r} was taken, not {passed_over}"
        return replace(raw, notes=(*raw.notes, note))
    needed = "all columns that are needed" if table is None else f"the name {quoted(table)!r}"
    lines = [
        f"  - {quoted(candidate.name)}: {listing(candidate.headers, 6) or 'columns without names'}"
        for candidate in (suitable or tables)[:12]
    ]
    head = f"{source} must have one table with {needed}; {len(suitable)} of its {len(tables)} have. {remark}".rstrip()
    end = "Choose one with --table NAME, and say what a column is with --column HEADER=COLUMN."
    raise TableError("\n".join([head, *lines, end]))


def _named(tables: Sequence[RawTable], name: str) -> Sequence[RawTable]:
    """The tables of a name, or of a name's end."""
    exact = [candidate for candidate in tables if candidate.name == name]
    return exact or [each for each in tables if each.name.casefold().endswith(name.strip().casefold())]
