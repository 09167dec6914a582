"""A table as it stands in its file, text or typed columns: headers, cells, and where each row came from.

The net under every library that decodes a foreign file: a damaged one is said to be damaged, whatever was raised.
"""

import codecs
import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import FemfitError, TableError
from femfit.core.numerics import FloatArray
from femfit.core.text import quoted
from femfit.tables.number_text import LARGEST


@contextmanager
def decoding(source: object, kind: str) -> Iterator[None]:
    """Turn any exception into a TableError, but for femfit's own and for too little memory.

    Libraries raise over damaged files what their authors never thought of: no list of exceptions is complete.
    """
    try:
        yield
    except (FemfitError, MemoryError):
        raise
    except Exception as error:
        reason = quoted(f"{type(error).__name__}: {error}", 300)
        raise TableError(
            f"{source} cannot be read as {kind}; it seems to be damaged ({reason}). Write it again, or export it as "
            "CSV."
        ) from error


PARQUET_MAGIC = b"PAR1"
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
MOST_COLUMNS = 2000
"""A table that is wider was read with the wrong delimiter, or is no table of measurements."""


@dataclass(frozen=True, eq=False)
class RawTable:
    """Cells of one file, or of one sheet, group, struct or array in it, not yet interpreted."""

    source: str
    headers: tuple[str, ...]  # One a column; empty if the file has none
    numbers: FloatArray  # NaN where the cell is no finite number; shape (n, m)
    texts: Callable[[int], Sequence[str]]  # The text of each cell of a column, by the column's place
    lines: Sequence[int]  # Line (text) or row (Parquet) of each row in the file, from 1; shape (n,)
    dialect: str  # Encoding, delimiter and decimal mark in one phrase
    decimal: str = "."
    # Lines with more or fewer cells than the table has columns: their cells may stand in wrong columns
    ragged: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()  # What was passed over: comment lines, repeated headers
    name: str = ""  # Among the tables of a file that may have several
    typed: pd.DataFrame | None = None  # The columns themselves, where the file says their types

    def column(self, header: str) -> FloatArray:
        """Return the numbers of a column, shape (n,)."""
        return np.array(self.numbers[:, self.headers.index(header)])

    def text(self, header: str) -> Sequence[str]:
        """Return the cells of a column."""
        return self.texts(self.headers.index(header))

    def frame(self) -> pd.DataFrame:
        """Return the columns by their headers: whole numbers, numbers, or text where a filled cell is no number."""
        if self.typed is not None:
            return self.typed
        columns = {}
        for k, header in enumerate(self.headers):
            cells = self.texts(k)
            worded = any(np.isnan(number) and cell for number, cell in zip(self.numbers[:, k], cells, strict=True))
            counts = all(len(cell) < 16 and cell.lstrip("-").isdecimal() for cell in cells)  # as exact in a double
            columns[header] = list(cells) if worded else self.numbers[:, k].astype(np.int64 if counts else np.float64)
        return pd.DataFrame(columns)


def file_content(path: str | Path, what: str) -> bytes:
    """Read a file whole."""
    path = Path(path)
    if not path.is_file():
        raise TableError(f"There is no {what} {path}. Give a .csv, .parquet, .xlsx, .mat, .h5, .tdms or .wav file.")
    try:
        return path.read_bytes()
    except OSError as error:
        raise TableError(f"{path} cannot be read: {error.strerror or error}.") from error


def decode(content: bytes, source: str) -> tuple[str, str]:
    """Text of a file and its encoding."""
    if content.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise TableError(f"{source} is a spreadsheet of a kind that is not read (.xls, .ods); save it as .xlsx or CSV.")
    marked = [name for mark, name in _MARKS if content.startswith(mark)]
    # Windows-1252 leaves five codes undefined; Latin-1 takes every byte.
    for name in marked or ["utf-8", "cp1252", "latin-1"]:
        try:
            text = content.decode(name)
        except UnicodeError:
            continue
        if "\x00" in text:
            raise TableError(f"{source} is no text table (it holds NUL characters); export it as CSV or Parquet.")
        return text.removeprefix("\ufeff"), name
    raise TableError(f"{source} is not written in {marked[0]}, as its first bytes say. Save it again as UTF-8.")


def parse_parquet(content: bytes, source: str) -> RawTable:
    """Read a Parquet table."""
    with decoding(source, "Parquet"):
        frame = pd.read_parquet(io.BytesIO(content))
    if any(level is not None for level in frame.index.names):
        frame = frame.reset_index()
    return raw_table_of(frame, source, "Parquet")


def raw_table_of(frame: pd.DataFrame, source: str, dialect: str, name: str = "") -> RawTable:
    """Return typed columns as a table."""
    check_width(frame.shape[1], source)
    columns = [typed_numbers(frame.iloc[:, k]) for k in range(frame.shape[1])]

    def texts(k: int) -> list[str]:  # when they are asked for: a long record is rarely shown
        column = frame.iloc[:, k]
        return ["" if missing else str(cell) for cell, missing in zip(column, column.isna(), strict=True)]

    return RawTable(
        source=source,
        headers=tuple(str(name) for name in frame.columns),
        numbers=np.array(columns, dtype=np.float64).reshape(frame.shape[1], len(frame)).T,
        texts=texts,
        lines=range(1, len(frame) + 1),
        dialect=dialect,
        name=name,
        typed=frame,
    )


def typed_numbers(column: "pd.Series[Any]") -> FloatArray:
    """Convert a typed column; moments of a clock become seconds from the first one. NaN where there is no number."""
    kind = column.dtype
    if pd.api.types.is_datetime64_any_dtype(kind) or pd.api.types.is_timedelta64_dtype(kind):
        elapsed = pd.to_timedelta(column - (column.dropna().iloc[0] if column.notna().any() else pd.NaT))
        return np.asarray(elapsed.dt.total_seconds().to_numpy(dtype=np.float64, na_value=np.nan))
    values = pd.to_numeric(column, errors="coerce").to_numpy(dtype=np.float64, na_value=np.nan)
    return np.where(np.abs(values) < LARGEST, values, np.nan)


def check_width(columns: int, source: str) -> None:
    """Refuse a table with an absurd number of columns."""
    if columns > MOST_COLUMNS:
        raise TableError(
            f"{source} has {columns} columns, where at most {MOST_COLUMNS} are read. Check its delimiter, or leave out "
            "what is not needed."
        )
