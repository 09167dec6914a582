"""Records over time as files, written block by block: CSV, Parquet, raw float32 with a sidecar."""

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from femfit.core.errors import OutputError, TableError
from femfit.core.files import replacing
from femfit.core.numerics import FloatArray
from femfit.tables.coil_record import RAW, RAW_SUFFIXES

_LONGEST_GAP = 2**24
"""Missing samples in a block up to which they are written to a raw record, as NaN."""


class RecordWriter:
    """Writes columns block by block; the file appears when all is written.

    Parameters
    ----------
    path : Path
        ``.csv``, ``.parquet``, or ``.bin``, ``.raw``, ``.f32`` (with a JSON sidecar).
    """

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
        sidecar = None
        if self.path.suffix in RAW_SUFFIXES:  # which appears with the record, or not at all
            sidecar = self._open.enter_context(replacing(self.path.with_suffix(".json")))
        partial = self._open.enter_context(replacing(self.path))
        if self.path.suffix == ".parquet":
            schema = pa.schema([(name, pa.float64()) for name in self.columns])
            self._parquet = self._open.enter_context(pq.ParquetWriter(partial, schema))
        else:
            self._file = self._open.enter_context(partial.open("wb"))
        if sidecar is not None:
            self._open.callback(self._describe, sidecar)
        return self

    def write(self, block: Mapping[str, FloatArray]) -> None:
        """Append rows."""
        if self._rows == 0:
            self._start = float(block["time_s"][0])
        self._rows += len(block["time_s"])
        if self._parquet is not None:
            self._parquet.write_table(pa.table({name: block[name] for name in self.columns}))
        elif self._file is not None and self.path.suffix == ".csv":
            header = ",".join(self.columns) + "\n" if self._rows == len(block["time_s"]) else ""
            self._file.write((header + self._lines(block)).encode())
        elif self._file is not None:
            self._file.write(self._evenly_spaced(block).astype(RAW).tobytes())

    def _lines(self, block: Mapping[str, FloatArray]) -> str:
        """The rows of a CSV file: one format for all numbers, three times as quick as a call for each."""
        values = np.stack([block[name] for name in self.columns], axis=1)
        line = ",".join(["%.10g"] * len(self.columns)) + "\n"
        text = line * len(values) % tuple(values.ravel().tolist())
        return text.replace("nan", "") if np.isnan(values).any() else text

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

    def _describe(self, sidecar: Path) -> None:
        """Write a raw record's sidecar."""
        rate = round(1.0 / self.sample_time, 6)
        side = {"sample_rate_Hz": rate, "start_s": self._start, "columns": self.columns[1:]}
        sidecar.write_text(json.dumps(side, indent=1) + "\n", encoding="utf-8")
