"""Coil records as files, read block by block: text, Parquet, raw float32 with a sidecar; other kinds are read whole.

A raw record holds interleaved little-endian float32 columns without header, a row each sample time; missing samples are
NaN. Its sidecar, ``NAME.toml`` or ``NAME.json`` beside it, says ``sample_rate_Hz``, ``columns`` and, where it is not 0,
``start_s``.

A stretch of a coil record: what a search coil, a Hall probe and a current sensor read. numpy only.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from pydantic import BaseModel, Field, FiniteFloat, ValidationError

from femfit.core.errors import TableError
from femfit.core.files import path_of, read_settings
from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.text import counted, quoted
from femfit.tables.columns import UsedColumn, recognise
from femfit.tables.number_text import EMPTY, find_decimal, looks_numeric
from femfit.tables.raw_table import RawTable, check_width, decode, decoding, typed_numbers
from femfit.tables.reading import Wants, Words, read_raw_table
from femfit.tables.table_file import is_container
from femfit.tables.text_table import find_layout, text_lines


@dataclass(frozen=True, eq=False)
class CoilBlock:
    """Consecutive samples of a coil record; one sample is a block too."""

    time: FloatArray  # In s, rising; shape (n,)
    voltage: FloatArray  # Of the coil in V; positive for a rising field; shape (n,)
    hall: FloatArray | None = None  # Hall probe's reading in T; NaN where there is none; shape (n,)
    current: FloatArray | None = None  # Excitation current in A; shape (n,)

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: slice | IntArray | BoolArray) -> "CoilBlock":
        return CoilBlock(**{name: column[rows] for name, column in vars(self).items() if column is not None})


BLOCK_ROWS = 2**18
"""Samples of a block: small enough for the memory, large enough for numpy."""

RAW_SUFFIXES = (".bin", ".raw", ".f32")
COLUMNS = ("coil_voltage_V", "hall_T", "current_A")
COIL = Wants(
    "coil record",
    ("time_s", *COLUMNS),
    needs=("time_s", "coil_voltage_V"),
    hints=dict.fromkeys(("time_s", "coil_voltage_V"), "A filter needs hall_T or current_A as well."),
)

RAW = np.dtype("<f4")
"""A number of a raw record."""

_HEAD = 2**16
"""Bytes of a text record by which its layout is found."""

_HIGHEST_RATE_HZ = 1e12
_RAW_EXAMPLE = 'sample_rate_Hz = 1000 and columns = ["coil_voltage_V"]'


@dataclass(frozen=True)
class CoilRecord:
    """A coil record that lies in a file."""

    path: Path
    headers: tuple[str, ...]
    used: tuple[UsedColumn, ...]  # The time and what else is read, each with its header and its factor to SI
    samples: int | None  # Rows; None where only reading shows it (CSV)
    layout: Mapping[str, Any]  # Of a raw record its sidecar, of a text record the arguments of ``pandas.read_csv``
    held: RawTable | None = None  # The record itself, of a kind of file that is read whole

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns in the file, without the time."""
        return tuple(name for name in COLUMNS if name in {column.name for column in self.used})

    def blocks(self, rows: int = BLOCK_ROWS) -> Iterator[CoilBlock]:
        """The record's blocks in order; rows without a time or a voltage are left out and show as gaps."""
        before, count = -np.inf, 0
        for table in self._tables(rows):
            time, voltage = table["time_s"], table["coil_voltage_V"]
            complete = np.isfinite(time) & np.isfinite(voltage)
            block = CoilBlock(time, voltage, table.get("hall_T"), table.get("current_A"))
            if not complete.all():
                block = block[complete]
            time = block.time
            if len(time) == 0:
                continue
            back = np.flatnonzero(np.diff(time, prepend=before) <= 0.0)
            if len(back):
                moment = float(time[back[0]])
                raise TableError(
                    f"{self.path} must have a rising time_s; it jumps back to {moment:.9g} s after "
                    f"{counted(int(count + back[0]), 'row')}. "
                    "Split the record there, or repair the clock."
                )
            before, count = float(time[-1]), count + len(time)
            yield block
        if count == 0:
            raise TableError(f"{self.path} has no row with a time and a voltage.")

    def _tables(self, rows: int) -> Iterator[dict[str, FloatArray]]:
        if self.held is not None:
            values = {column.name: column.factor * self.held.column(column.header) for column in self.used}
            for first in range(0, len(self.held.lines), rows):
                yield {name: column[first : first + rows] for name, column in values.items()}
            return
        kinds = {".parquet": self._parquet_tables, **dict.fromkeys(RAW_SUFFIXES, self._raw_tables)}
        tables = kinds.get(self.path.suffix, self._text_tables)(rows)
        while True:
            with decoding(self.path, "a coil record"):
                table = next(tables, None)
                if table is None:
                    return
                values = {c.name: c.factor * self._numbers(table[c.header], c.header) for c in self.used}
            yield values

    def _parquet_tables(self, rows: int) -> Iterator[pd.DataFrame]:
        headers, first = [column.header for column in self.used], None
        with pq.ParquetFile(self.path) as file:
            for batch in file.iter_batches(batch_size=rows, columns=headers):
                table = batch.to_pandas()
                for header in headers:  # moments of a clock count from the record's first one
                    if table[header].dtype.kind in "mM":
                        first = table[header].dropna().iloc[:1] if first is None or first.empty else first
                        begin = pd.NaT if first.empty else first.iloc[0]
                        table[header] = (table[header] - begin).dt.total_seconds()
                yield table

    def _text_tables(self, rows: int) -> Iterator[pd.DataFrame]:
        names = dict(enumerate(self.headers))
        try:  # all columns are read, so that a line with too many cells is an error
            with pd.read_csv(self.path, chunksize=rows, **self.layout) as chunks:
                yield from (chunk.rename(columns=names) for chunk in chunks)
        except pd.errors.EmptyDataError:
            return  # names without rows

    def _numbers(self, column: "pd.Series[Any]", header: str) -> FloatArray:
        if column.dtype.kind not in "iufM" and self.layout.get("decimal") == ",":
            column = column.map(lambda cell: cell.replace(",", ".") if isinstance(cell, str) else cell)
        values = typed_numbers(column)
        if column.dtype.kind in "iuf":
            return values
        bad = np.flatnonzero(np.isnan(values) & column.notna().to_numpy())
        for k in bad[:1]:
            raise TableError(
                f"Column {quoted(header)} of {self.path} must hold numbers; instead received "
                f"{quoted(column.iloc[int(k)])!r}. Repair these cells."
            )
        return values

    def _raw_tables(self, rows: int) -> Iterator[pd.DataFrame]:
        names, rate, begin = self.layout["columns"], self.layout["sample_rate_Hz"], self.layout["start_s"]
        done = 0
        with self.path.open("rb") as file:
            while len(values := np.fromfile(file, RAW, rows * len(names))):
                table = pd.DataFrame(values.reshape(-1, len(names)).astype(np.float64), columns=names)
                table["time_s"] = begin + (done + np.arange(len(table))) / rate
                done += len(table)
                yield table


def open_coil_record(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str | float] | None = None,
    table: str | None = None,
) -> CoilRecord:
    """Look at a coil record; text, Parquet and raw records are not read before their blocks are asked for.

    It is ``.parquet``; ``.bin``, ``.raw`` or ``.f32`` with a sidecar; XLSX, MAT, HDF5, TDMS or WAV; else a text table
    of any dialect. ``columns``, ``units`` and ``table`` are as in
    :func:`femfit.tables.measurement_file.read_measurement`.
    """
    path = path_of(path, "A coil record")
    if not path.is_file():
        raise TableError(
            f"There is no coil record {path}. Give a text, .parquet, .bin, .raw, .f32, .mat, .h5, .tdms or .wav file."
        )
    words = Words(columns or {}, units or {}, table)
    held = None
    layout: dict[str, Any] = {}
    samples = None
    with decoding(path, "a coil record"):
        if path.suffix in RAW_SUFFIXES:
            layout = _raw_layout(path)
            headers = ["time_s", *layout["columns"]]
            samples = path.stat().st_size // (RAW.itemsize * len(layout["columns"]))
        elif path.suffix == ".parquet":
            with pq.ParquetFile(path) as file:
                headers, samples = list(file.schema_arrow.names), file.metadata.num_rows
        elif is_container(path):
            held = read_raw_table(path, COIL.what, (COIL,), words)
            headers, samples = list(held.headers), len(held.lines)
        else:
            headers, layout = _text_layout(path)
    check_width(len(headers), str(path))
    used, findings = recognise(headers, str(path), COIL.names, words.columns, words.units)
    COIL.require([column.name for column in used], headers, str(path), used, findings)
    return CoilRecord(path, tuple(headers), tuple(used), samples, layout, held)


def _text_layout(path: Path) -> tuple[list[str], dict[str, Any]]:
    """The headers of a text record, and how pandas reads what stands below them."""
    with path.open("rb") as file:
        content = file.read(_HEAD)
        complete = not file.read(1)
    if not complete:
        if b"\n" not in content:
            raise TableError(f"Line 1 of {path} has more than {_HEAD} characters. Check that it is a text table.")
        content = content[: max(content.rfind(b"\n"), 0) + 1] or content
        content += b"\x00" * (len(content) % 2 and b"\x00" in content[:64])  # the other half of a UTF-16 line end
    text, encoding = decode(content, str(path))
    lines = text_lines(text)
    if not lines:
        raise TableError(f"{path} is empty; it needs a line of column names and rows of numbers.")
    lines, layout = find_layout(lines, str(path))
    rows = [line.cells for line in lines if line.number >= layout.first and not line.comment]
    marked = (cell for row in rows for cell in row if "," in cell and looks_numeric(cell))
    skipped = layout.first - 1 if layout.first <= lines[-1].number else lines[-1].number
    arguments: dict[str, Any] = {
        "encoding": encoding,
        "encoding_errors": "replace",
        "sep": r"\s+" if layout.delimiter == " " else layout.delimiter,
        "decimal": find_decimal(marked, str(path), ","),
        "header": None,
        "skiprows": skipped,
        "skipinitialspace": True,
        "na_values": sorted(EMPTY),
    }
    return list(layout.headers), arguments


class _RawLayout(BaseModel):
    """The sidecar of a raw record."""

    sample_rate_Hz: float = Field(gt=0.0, le=_HIGHEST_RATE_HZ)
    columns: list[str] = Field(min_length=1)
    start_s: FiniteFloat = 0.0


def _raw_layout(path: Path) -> dict[str, Any]:
    """The checked sidecar of a raw record."""
    sides = [side for side in (path.with_suffix(".toml"), path.with_suffix(".json")) if side.is_file()]
    if not sides:
        raise TableError(
            f"{path} needs a sidecar {path.stem}.toml or {path.stem}.json beside it, with sample_rate_Hz and columns."
        )
    data = read_settings(sides[0], _RAW_EXAMPLE)
    try:
        layout = _RawLayout.model_validate(data, strict=True).model_dump()
    except ValidationError as error:
        fault = error.errors()[0]
        key, received = ".".join(map(str, fault["loc"])), quoted(data.get(str(fault["loc"][0])))
        raise TableError(f"{sides[0]} needs {_RAW_EXAMPLE}; {key} is {received}: {fault['msg']}.") from error
    columns = layout["columns"]
    if len(set(columns)) < len(columns):
        raise TableError(f"{sides[0]} must name each column once; instead received columns = {quoted(columns)}.")
    if path.stat().st_size % (RAW.itemsize * len(columns)):
        raise TableError(
            f"{path} must hold whole rows of {len(columns)} float32; its {path.stat().st_size} bytes do not. Check the "
            "sidecar's columns."
        )
    return layout
