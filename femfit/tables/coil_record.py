"""Coil records as files, read and written block by block: CSV, Parquet, raw float32 with a sidecar.

A raw record holds interleaved little-endian float32 columns without header, a row each sample time; missing samples are
NaN. Its sidecar, ``NAME.toml`` or ``NAME.json`` beside it, says ``sample_rate_Hz``, ``columns`` and, where it is not 0,
``start_s``.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from femfit.core.amount import counted
from femfit.core.arrays import FloatArray
from femfit.core.atomic import replacing, write_json
from femfit.core.errors import OutputError, TableError
from femfit.core.finding import listing
from femfit.core.paths import path_of
from femfit.core.quoted import quoted
from femfit.tables.coil_block import CoilBlock
from femfit.tables.columns import UsedColumn, recognise
from femfit.tables.number_text import EMPTY, find_decimal, looks_numeric
from femfit.tables.raw_table import check_width, decode, typed_numbers
from femfit.tables.settings_file import finite_number, read_settings
from femfit.tables.text_table import find_layout, split, text_lines

BLOCK_ROWS = 2**18
"""Samples of a block: small enough for the memory, large enough for numpy."""

RAW_SUFFIXES = (".bin", ".raw", ".f32")
COLUMNS = ("coil_voltage_V", "hall_T", "current_A")

_RAW = np.dtype("<f4")
_HEAD = 2**16
"""Bytes of a text record by which its layout is found."""

_HIGHEST_RATE_HZ = 1e12
_LONGEST_GAP = 2**24
"""Missing samples in a block up to which they are written to a raw record, as NaN."""


@dataclass(frozen=True)
class CoilRecord:
    """A coil record that lies in a file."""

    path: Path
    headers: tuple[str, ...]
    used: tuple[UsedColumn, ...]  # The time and what else is read, each with its header and its factor to SI
    samples: int | None  # Rows; None where only reading shows it (CSV)
    layout: Mapping[str, Any]  # Of a raw record its sidecar, of a text record the arguments of ``pandas.read_csv``

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns in the file, without the time."""
        return tuple(name for name in COLUMNS if name in {column.name for column in self.used})

    def blocks(self, rows: int = BLOCK_ROWS) -> Iterator[CoilBlock]:
        """The record's blocks in order; rows without a time or a voltage are left out and show as gaps."""
        before, seen = -np.inf, 0
        for table in self._tables(rows):
            time, voltage = table["time_s"], table["coil_voltage_V"]
            known = np.isfinite(time) & np.isfinite(voltage)
            block = CoilBlock(time, voltage, table.get("hall_T"), table.get("current_A"))
            if not known.all():
                block = block[known]
            time = block.time
            if len(time) == 0:
                continue
            back = np.flatnonzero(np.diff(time, prepend=before) <= 0.0)
            if len(back):
                at = float(time[back[0]])
                raise TableError(
                    f"{self.path} must have a rising time_s; it jumps back to {at:.9g} s after "
                    f"{counted(int(seen + back[0]), 'row')}. "
                    "Split the record there, or repair the clock."
                )
            before, seen = float(time[-1]), seen + len(time)
            yield block
        if seen == 0:
            raise TableError(f"{self.path} has no row with a time and a voltage.")

    def _tables(self, rows: int) -> Iterator[dict[str, FloatArray]]:
        if self.path.suffix in RAW_SUFFIXES:
            yield from self._raw_tables(rows)
            return
        try:
            tables = self._parquet_tables(rows) if self.path.suffix == ".parquet" else self._text_tables(rows)
            for table in tables:
                yield {c.name: c.factor * self._numbers(table[c.header], c.header) for c in self.used}
        except (OSError, ValueError, pa.ArrowException) as error:
            if isinstance(error, TableError):
                raise
            raise TableError(f"Coil record {self.path} is damaged: {quoted(error, 300)}.") from error

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

    def _raw_tables(self, rows: int) -> Iterator[dict[str, FloatArray]]:
        names, rate, begin = self.layout["columns"], self.layout["sample_rate_Hz"], self.layout["start_s"]
        done = 0
        with self.path.open("rb") as file:
            while len(values := np.fromfile(file, _RAW, rows * len(names))):
                table = values.reshape(-1, len(names)).astype(np.float64)
                time = begin + (done + np.arange(len(table))) / rate
                done += len(table)
                yield {"time_s": time, **{name: np.ascontiguousarray(table[:, k]) for k, name in enumerate(names)}}


def open_coil_record(path: str | Path) -> CoilRecord:
    """Look at a coil record without reading it.

    It is ``.parquet``; ``.bin``, ``.raw`` or ``.f32`` with a sidecar; else a text table of any dialect.
    """
    path = path_of(path, "A coil record")
    if not path.is_file():
        raise TableError(f"There is no coil record {path}. Give a .csv, .parquet, .bin, .raw or .f32 file.")
    layout: dict[str, Any] = {}
    samples = None
    try:
        if path.suffix in RAW_SUFFIXES:
            layout = _raw_layout(path)
            headers = ["time_s", *layout["columns"]]
            samples = path.stat().st_size // (_RAW.itemsize * len(layout["columns"]))
        elif path.suffix == ".parquet":
            with pq.ParquetFile(path) as file:
                headers, samples = list(file.schema_arrow.names), file.metadata.num_rows
        else:
            headers, layout = _text_layout(path)
    except (OSError, ValueError, pa.ArrowException) as error:
        if isinstance(error, TableError):
            raise
        raise TableError(f"Coil record {path} cannot be read: {quoted(error, 300)}.") from error
    check_width(len(headers), str(path))
    used, _ = recognise(headers, str(path), ("time_s", *COLUMNS))
    missing = [name for name in ("time_s", "coil_voltage_V") if name not in {column.name for column in used}]
    if missing:
        raise TableError(
            f"A coil record needs the columns time_s and coil_voltage_V, and hall_T or current_A for a filter; {path} "
            f"has {listing(headers, 20) or 'none'}. Rename or add {' and '.join(missing)}."
        )
    return CoilRecord(path, tuple(headers), tuple(used), samples, layout)


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
    lines = text_lines(text, str(path))
    if not lines:
        raise TableError(f"{path} is empty; it needs a line of column names and rows of numbers.")
    lines, layout = find_layout(lines, str(path))
    rows = [split(line.text, layout.delimiter) for line in lines if line.number >= layout.first and not line.comment]
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


def _raw_layout(path: Path) -> dict[str, Any]:
    """The checked sidecar of a raw record."""
    sides = [side for side in (path.with_suffix(".toml"), path.with_suffix(".json")) if side.is_file()]
    if not sides:
        raise TableError(
            f"{path} needs a sidecar {path.stem}.toml or {path.stem}.json beside it, with sample_rate_Hz and columns."
        )
    data, *others = (read_settings(side, 'sample_rate_Hz = 1000 and columns = ["coil_voltage_V"]') for side in sides)
    if others and others[0] != data:
        raise TableError(
            f"{path} has two sidecars that differ, {sides[0].name} and {sides[1].name}. Delete the one that does not "
            "belong to it."
        )
    rate, columns, start = data.get("sample_rate_Hz"), data.get("columns"), data.get("start_s", 0.0)
    named = isinstance(columns, list) and len(columns) > 0 and all(isinstance(name, str) for name in columns)
    rate, start = finite_number(rate), finite_number(start)
    if not (rate is not None and 0 < rate <= _HIGHEST_RATE_HZ and isinstance(columns, list) and named):
        raise TableError(
            f'{sides[0]} needs sample_rate_Hz > 0 and columns = ["coil_voltage_V", ...]; instead received '
            f"sample_rate_Hz = {quoted(data.get('sample_rate_Hz'))}, columns = {quoted(columns)}."
        )
    if len(set(columns)) < len(columns):
        raise TableError(f"{sides[0]} must name each column once; instead received columns = {quoted(columns)}.")
    if start is None:
        received = quoted(data["start_s"])
        raise TableError(f"start_s in {sides[0]} must be a number of seconds; instead received {received}.")
    if path.stat().st_size % (_RAW.itemsize * len(columns)):
        raise TableError(
            f"{path} must hold whole rows of {len(columns)} float32; its {path.stat().st_size} bytes do not. Check the "
            "sidecar's columns."
        )
    return {"sample_rate_Hz": rate, "start_s": start, "columns": columns}


class RecordWriter:
    """Writes columns block by block, as CSV, Parquet or raw with a sidecar; the file appears when all is written."""

    def __init__(self, path: Path, columns: Sequence[str], sample_time: float) -> None:
        self.path, self.columns, self.sample_time = Path(path), list(columns), sample_time
        if self.path.suffix not in {".csv", ".parquet", *RAW_SUFFIXES}:
            raise TableError(
                f"An integrated record is written as .csv, .parquet, .bin, .raw or .f32; instead received {path.name}."
            )
        if self.path.suffix in RAW_SUFFIXES and self.path.with_suffix(".toml").exists():
            raise OutputError(
                f"{self.path.with_suffix('.toml')} would be taken for the sidecar of {self.path.name}. Choose another "
                "name, or delete that file."
            )
        self._start, self._last = 0.0, np.nan
        self._rows = 0
        self._open = ExitStack()
        self._file: BinaryIO | None = None
        self._parquet: pq.ParquetWriter | None = None

    def __enter__(self) -> Self:
        partial = self._open.enter_context(replacing(self.path))
        if self.path.suffix == ".parquet":
            schema = pa.schema([(name, pa.float64()) for name in self.columns])
            self._parquet = self._open.enter_context(pq.ParquetWriter(partial, schema))
        else:
            self._file = self._open.enter_context(partial.open("wb"))
        return self

    def write(self, block: Mapping[str, FloatArray]) -> None:
        """Append rows."""
        if self._rows == 0:
            self._start = float(block["time_s"][0])
        self._rows += len(block["time_s"])
        if self._parquet is not None:
            self._parquet.write_table(pa.table({name: block[name] for name in self.columns}))
        elif self.path.suffix == ".csv":
            first = self._rows == len(block["time_s"])
            pd.DataFrame({name: block[name] for name in self.columns}).to_csv(
                self._file, index=False, header=first, float_format="%.10g"
            )
        elif self._file is not None:
            self._evenly_spaced(block).astype(_RAW).tofile(self._file)

    def _evenly_spaced(self, block: Mapping[str, FloatArray]) -> FloatArray:
        """The rows of a raw record, with NaN for each sample that a gap of the clock left out."""
        time = block["time_s"]
        values = np.stack([block[name] for name in self.columns[1:]], axis=1)
        steps = np.diff(time, prepend=time[0] - self.sample_time if np.isnan(self._last) else self._last)
        places = np.cumsum(np.maximum(np.rint(steps / self.sample_time), 1.0)).astype(np.intp) - 1
        self._last = float(time[-1])
        if places[-1] - len(time) > _LONGEST_GAP:
            raise TableError(
                f"{self.path} cannot hold a gap of {places[-1] - len(time):.3g} samples: a raw record has a row for "
                "each sample time. Write .parquet or .csv."
            )
        rows = np.full((places[-1] + 1, values.shape[1]), np.nan)
        rows[places] = values
        return rows

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.__exit__(kind, error, trace)
        if error is None and self.path.suffix in RAW_SUFFIXES:
            side = {
                "sample_rate_Hz": round(1.0 / self.sample_time, 6),
                "start_s": self._start,
                "columns": self.columns[1:],
            }
            write_json(self.path.with_suffix(".json"), side)
