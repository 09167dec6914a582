"""Coil records as files, read block by block: text, Parquet, raw float32 with a sidecar; other kinds are read whole.

A raw record holds interleaved little-endian float32 columns without header, a row each sample time; missing samples are
NaN. Its sidecar, ``NAME.toml`` or ``NAME.json`` beside it, says ``sample_rate_Hz``, ``columns`` and, where it is not 0,
``start_s``.

A stretch of a coil record: what a search coil, a Hall probe and a current sensor read. numpy only.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from pydantic import BaseModel, Field, FiniteFloat, ValidationError

from femfit.core.errors import TableError
from femfit.core.files import path_of, read_settings, reading
from femfit.core.numerics import LARGEST, BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.core.text import quoted
from femfit.tables.checks import impossible
from femfit.tables.columns import UsedColumn, match_columns
from femfit.tables.containers import is_container, require_no_choice
from femfit.tables.findings import finding, refused
from femfit.tables.raw_table import AGAIN, EMPTY, check_width, find_decimal, looks_numeric, typed_numbers
from femfit.tables.reading import Wants, Words, read_raw_table, require_single_names, words_of
from femfit.tables.text_table import decode, find_layout


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
    hints={"coil_voltage_V": "A filter needs hall_T or current_A beside it."},
)

RAW = np.dtype("<f4")
_HEAD = 2**16
"""Bytes of a text record by which its layout is found."""

_RAW_EXAMPLE = 'sample_rate_Hz = 1000 and columns = ["coil_voltage_V"]'


Tables = Callable[[int], Iterator[pd.DataFrame]]
"""A record's columns by their headers, so many rows at a time."""


@dataclass(frozen=True)
class CoilRecord:
    """A coil record that lies in a file, or in memory."""

    source: str
    used: tuple[UsedColumn, ...]  # The time and what else is read, each with its header and its factor to SI
    samples: int | None  # Rows; None where only reading shows it (CSV)
    tables: Tables
    unused: tuple[Finding, ...] = ()  # Which columns are not read
    # Samples that the blocks read last left out, by what is said of them and their column
    lost: Counter[tuple[str, str]] = field(default_factory=Counter)

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns in the file, without the time."""
        return tuple(name for name in COLUMNS if name in {column.name for column in self.used})

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is not used of the file: columns, and samples of the blocks that were read."""
        lost = ((key, name, count) for (key, name), count in self.lost.items() if count)
        return (*self.unused, *(finding(key, column=name, size=count, cells=count) for key, name, count in lost))

    def blocks(self, rows: int = BLOCK_ROWS) -> Iterator[CoilBlock]:
        """The record's blocks in order; rows without a time or a voltage are left out and show as gaps."""
        before, count = -np.inf, 0
        self.lost.clear()
        with reading(self.source, AGAIN, " as a coil record"):
            for table in self.tables(rows):
                read = {}
                for use in self.used:
                    cells = table[use.header]
                    read[use.name] = use.factor * typed_numbers(cells)
                    missing, beyond = np.isnan(read[use.name]), impossible(read[use.name], use.name)
                    self.lost["cells missing", use.name] += int(missing.sum()) if use.name in COIL.needs else 0
                    self.lost["cells impossible", use.name] += int(beyond.sum())
                    read[use.name][beyond] = np.nan
                    bad = cells[missing & cells.notna()]
                    if len(bad) and cells.dtype.kind not in "iuf":
                        facts = {"header": quoted(use.header), "cell": quoted(bad.iloc[0])}
                        raise refused("numbers-needed", source=self.source, **facts)
                block = CoilBlock(read["time_s"], read["coil_voltage_V"], read.get("hall_T"), read.get("current_A"))
                block = block[np.isfinite(block.time) & np.isfinite(block.voltage)]
                if len(block) == 0:
                    continue
                back = np.flatnonzero(np.diff(block.time, prepend=before) < 1.0 / LARGEST)
                if len(back):
                    moment, before_it = block.time[back[0]], int(count + back[0])
                    raise refused("clock-back", source=self.source, moment=moment, rows=before_it)
                before, count = float(block.time[-1]), count + len(block)
                yield block
        if count == 0:
            raise TableError(f"No row of {self.source} has a time and a voltage.")


IN_MEMORY = "the table"
"""What messages call a record that lies in no file."""


def open_coil_record(
    record: str | Path | pd.DataFrame,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str | float] | None = None,
    table: str | None = None,
) -> CoilRecord:
    """Look at a coil record; text, Parquet and raw records are not read before their blocks are asked for.

    It is ``.parquet``; ``.bin``, ``.raw`` or ``.f32`` with a sidecar; XLSX, MAT, HDF5, TDMS or WAV; else a text table
    of any dialect, or a DataFrame. ``columns``, ``units`` and ``table`` are as in
    :func:`femfit.tables.measurement_file.read_measurement`, in a sidecar too.
    """
    words = Words(columns or {}, units or {}, table)
    content: Record
    if isinstance(record, pd.DataFrame):
        source, names = IN_MEMORY, list(map(str, record))
        require_no_choice(source, table)
        content = names, len(record), lambda _: iter([record.set_axis(names, axis=1)])
    else:
        path = path_of(record, "A coil record")
        source = str(path)
        if not path.is_file():
            raise refused("no-record", path=path)
        raw_record = path.suffix in RAW_SUFFIXES
        words = words if raw_record else words_of(path, words)
        with reading(path, AGAIN, " as a coil record"):
            contained = not raw_record and is_container(path)
            require_no_choice(source, None if contained else words.table)
            if raw_record:
                content = _raw_record(path)
            elif path.suffix == ".parquet":
                content = _parquet_record(path)
            elif contained:
                raw = read_raw_table(path, COIL.what, (COIL,), words)
                frame = pd.DataFrame(raw.numbers, columns=raw.headers)
                pieces = lambda rows: (frame[k : k + rows] for k in range(0, len(frame), rows))  # noqa: E731
                content = list(raw.headers), len(frame), pieces
            else:
                content = _text_record(path)
    headers, samples, tables = content
    check_width(len(headers), source)
    require_single_names(headers, source)
    used, findings = match_columns(headers, source, COIL.names, words.columns, words.units)
    COIL.require([column.name for column in used], headers, source, used, findings)
    return CoilRecord(source, tuple(used), samples, tables, tuple(findings))


Record = tuple[list[str], int | None, Tables]
"""A record's headers, its rows where they are known without reading, and its cells."""


def _parquet_record(path: Path) -> Record:
    def tables(rows: int) -> Iterator[pd.DataFrame]:
        first: dict[str, Any] = {}
        with pq.ParquetFile(path) as file:
            for batch in file.iter_batches(batch_size=rows):
                table = batch.to_pandas()
                for name in table.columns[[kind.kind in "mM" for kind in table.dtypes]]:
                    # Moments of a clock count from the record's first one, not from the block's
                    if name not in first and table[name].notna().any():
                        first[name] = table[name].dropna().iloc[0]
                    table[name] = (table[name] - first.get(name, pd.NaT)).dt.total_seconds()
                yield table

    with pq.ParquetFile(path) as file:
        return list(file.schema_arrow.names), file.metadata.num_rows, tables


def _text_record(path: Path) -> Record:
    with path.open("rb") as file:
        content, more = file.read(_HEAD), file.read(1)
    if more:
        if b"\n" not in content:
            raise TableError(f"Line 1 of {path} has more than {_HEAD} characters. Check that it is a text table.")
        content = content[: content.rfind(b"\n") + 1]
        content += b"\x00" * (len(content) % 2 and b"\x00" in content[:64])  # the other half of a UTF-16 line end
    text, encoding = decode(content, str(path))
    lines = text.splitlines()
    layout = find_layout(lines, str(path))
    marked = (cell for _, cells in layout.rows(lines) for cell in cells if "," in cell and looks_numeric(cell))
    decimal = find_decimal(marked, str(path), ",")
    options: Any = {
        "encoding": encoding,
        "encoding_errors": "replace",
        "sep": r"\s+" if layout.delimiter == " " else layout.delimiter,
        "decimal": decimal,
        "header": None,
        "skiprows": layout.first - 1,
        "skipinitialspace": True,
        "na_values": sorted(EMPTY),
    }

    def tables(rows: int) -> Iterator[pd.DataFrame]:
        # All columns are read, so that a line with too many cells is an error; names without rows are no data
        with suppress(pd.errors.EmptyDataError), pd.read_csv(path, chunksize=rows, **options) as chunks:
            for chunk in chunks:
                named = chunk.rename(columns=dict(enumerate(layout.headers)))
                yield named.replace(",", ".", regex=True) if decimal == "," else named

    return list(layout.headers), None, tables


class _RawLayout(BaseModel):
    """The sidecar of a raw record."""

    sample_rate_Hz: float = Field(gt=0.0, le=1e12)
    columns: list[str] = Field(min_length=1)
    start_s: FiniteFloat = 0.0


def _raw_record(path: Path) -> Record:
    sides = [side for side in (path.with_suffix(".toml"), path.with_suffix(".json")) if side.is_file()]
    if not sides:
        raise refused("no-layout", path=path, stem=path.stem)
    data = read_settings(sides[0], _RAW_EXAMPLE)
    try:
        layout = _RawLayout.model_validate(data, strict=True)
    except ValidationError as error:
        fault = error.errors()[0]
        key, received = ".".join(map(str, fault["loc"])), quoted(data.get(str(fault["loc"][0])))
        raise TableError(f"{sides[0]} needs {_RAW_EXAMPLE}; {key} is {received}: {fault['msg']}.") from error
    if len(set(layout.columns)) < len(layout.columns):
        raise TableError(f"{sides[0]} must name each column once; instead received columns = {quoted(layout.columns)}.")
    width, size = len(layout.columns), path.stat().st_size
    if size % (RAW.itemsize * width):
        raise refused("broken-rows", path=path, width=width, length=size)

    def tables(rows: int) -> Iterator[pd.DataFrame]:
        done = 0
        with path.open("rb") as file:
            while len(values := np.fromfile(file, RAW, rows * width)):
                table = pd.DataFrame(values.reshape(-1, width).astype(np.float64), columns=layout.columns)
                time = layout.start_s + (done + np.arange(len(table))) / layout.sample_rate_Hz
                yield table.assign(time_s=time)
                done += len(table)

    return ["time_s", *layout.columns], size // (RAW.itemsize * width), tables
