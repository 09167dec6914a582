"""Coil records as files, read and written block by block: CSV, Parquet, raw float32 with a sidecar.

A raw record holds interleaved little-endian float32 columns without header. Its sidecar, ``NAME.toml`` or ``NAME.json``
beside it, says ``sample_rate_Hz``, ``columns`` and, where it is not 0, ``start_s``.
"""

import json
import tomllib
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

from femfit.core.arrays import FloatArray
from femfit.core.atomic import replacing, write_json
from femfit.core.errors import TableError
from femfit.tables.coil_block import CoilBlock

BLOCK_ROWS = 2**18
"""Samples of a block: small enough for the memory, large enough for numpy."""

RAW_SUFFIXES = (".bin", ".raw", ".f32")
COLUMNS = ("coil_voltage_V", "hall_T", "current_A")

_RAW = np.dtype("<f4")


@dataclass(frozen=True)
class CoilRecord:
    """A coil record that lies in a file.

    Parameters
    ----------
    columns : tuple of str
        In the file, without the time.
    samples : int or None
        Rows; None where only reading tells (CSV).
    raw : mapping
        Sidecar of a raw record, empty otherwise.
    """

    path: Path
    columns: tuple[str, ...]
    samples: int | None
    raw: Mapping[str, Any]

    def blocks(self, rows: int = BLOCK_ROWS) -> Iterator[CoilBlock]:
        """The record's blocks in order; rows without a time or a voltage are left out and show as gaps.

        Raises
        ------
        TableError
            If a cell is no number, the time does not rise, or no row is left.
        """
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
                    f"{self.path} must have a rising time_s; it jumps back to {at:.9g} s after {seen + back[0]} rows. "
                    "Split the record there, or repair the clock."
                )
            before, seen = float(time[-1]), seen + len(time)
            yield block
        if seen == 0:
            raise TableError(f"{self.path} has no row with a time and a voltage.")

    def _tables(self, rows: int) -> Iterator[dict[str, FloatArray]]:
        if self.raw:
            yield from self._raw_tables(rows)
        elif self.path.suffix == ".parquet":
            names = ["time_s", *self.columns]
            with pq.ParquetFile(self.path) as file:
                for batch in file.iter_batches(batch_size=rows, columns=names):
                    yield {name: self._numbers(batch.column(name).to_pandas(), name) for name in names}
        else:
            with pd.read_csv(self.path, chunksize=rows, usecols=["time_s", *self.columns]) as chunks:
                for chunk in chunks:
                    yield {str(name): self._numbers(chunk[name], str(name)) for name in chunk}

    def _numbers(self, column: "pd.Series[Any]", name: str) -> FloatArray:
        try:
            return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan))
        except (ValueError, TypeError) as error:
            raise TableError(f"Column {name} of {self.path} must hold numbers; {error}. Repair these cells.") from error

    def _raw_tables(self, rows: int) -> Iterator[dict[str, FloatArray]]:
        names, rate, begin = self.raw["columns"], float(self.raw["sample_rate_Hz"]), float(self.raw.get("start_s", 0.0))
        done = 0
        with self.path.open("rb") as file:
            while len(values := np.fromfile(file, _RAW, rows * len(names))):
                table = values.reshape(-1, len(names)).astype(np.float64)
                time = begin + (done + np.arange(len(table))) / rate
                done += len(table)
                yield {"time_s": time, **{name: np.ascontiguousarray(table[:, k]) for k, name in enumerate(names)}}


def open_coil_record(path: Path) -> CoilRecord:
    """Look at a coil record without reading it.

    Parameters
    ----------
    path : Path
        ``.csv``, ``.parquet``, or ``.bin``, ``.raw``, ``.f32`` with a sidecar.

    Raises
    ------
    TableError
        If there is no such file, or it lacks a time or a coil voltage.
    """
    path = Path(path)
    if not path.is_file():
        raise TableError(f"There is no coil record {path}. Give a .csv, .parquet, .bin, .raw or .f32 file.")
    raw: dict[str, Any] = {}
    try:
        if path.suffix in RAW_SUFFIXES:
            raw = _sidecar(path)
            names, samples = ["time_s", *raw["columns"]], path.stat().st_size // (_RAW.itemsize * len(raw["columns"]))
        elif path.suffix == ".parquet":
            head = pq.ParquetFile(path)
            names, samples = list(head.schema_arrow.names), head.metadata.num_rows
        else:
            names, samples = [str(name) for name in pd.read_csv(path, nrows=0).columns], None
    except (OSError, ValueError, pa.ArrowException) as error:
        if isinstance(error, TableError):
            raise
        raise TableError(f"Coil record {path} cannot be read: {error}") from error
    missing = [name for name in ("time_s", "coil_voltage_V") if name not in names]
    if missing:
        raise TableError(
            f"A coil record needs the columns time_s and coil_voltage_V, and hall_T or current_A for a filter; {path} "
            f"has {', '.join(names) or 'none'}. Rename or add {' and '.join(missing)}."
        )
    return CoilRecord(path, tuple(name for name in COLUMNS if name in names), samples, raw)


def _sidecar(path: Path) -> dict[str, Any]:
    for candidate in (path.with_suffix(".toml"), path.with_suffix(".json")):
        if candidate.is_file():
            text = candidate.read_text(encoding="utf-8")
            data: dict[str, Any] = tomllib.loads(text) if candidate.suffix == ".toml" else json.loads(text)
            break
    else:
        raise TableError(
            f"{path} needs a sidecar {path.stem}.toml or {path.stem}.json beside it, with sample_rate_Hz and columns."
        )
    rate, columns = data.get("sample_rate_Hz"), data.get("columns")
    if not (isinstance(rate, int | float) and rate > 0 and isinstance(columns, list) and columns):
        raise TableError(
            f'{candidate} needs sample_rate_Hz > 0 and columns = ["coil_voltage_V", ...]; instead received '
            f"sample_rate_Hz = {rate!r}, columns = {columns!r}."
        )
    if path.stat().st_size % (_RAW.itemsize * len(columns)):
        raise TableError(
            f"{path} must hold whole rows of {len(columns)} float32; its {path.stat().st_size} bytes do not. Check the "
            "sidecar's columns."
        )
    return data


class RecordWriter:
    """Writes columns block by block; the file appears when all is written.

    Parameters
    ----------
    path : Path
        ``.csv``, ``.parquet``, or ``.bin``, ``.raw``, ``.f32`` (with a JSON sidecar).
    sample_time : float
        For a raw record's sidecar, s.
    """

    def __init__(self, path: Path, columns: Sequence[str], sample_time: float) -> None:
        self.path, self.columns, self.sample_time = Path(path), list(columns), sample_time
        if self.path.suffix not in {".csv", ".parquet", *RAW_SUFFIXES}:
            raise TableError(
                f"An integrated record is written as .csv, .parquet, .bin, .raw or .f32; instead received {path.name}."
            )
        self._start = 0.0
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
            np.stack([block[name] for name in self.columns[1:]], axis=1).astype(_RAW).tofile(self._file)

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
