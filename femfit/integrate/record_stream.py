"""A coil record streamed through an integrator: its rows kept or written, and what is wrong with it found.

Records over time as files, written block by block: CSV, Parquet, raw float32 with a sidecar.
"""

import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from femfit.core.errors import OutputError, TableError
from femfit.core.files import replacing
from femfit.core.numerics import FloatArray
from femfit.core.results import Finding
from femfit.integrate.identified_field import CurrentField
from femfit.integrate.methods import FEED_FORWARD, IntegrationOptions, integrate_blocks, make_integrator
from femfit.integrate.record_watch import RecordWatch, Reference, finding
from femfit.integrate.uncertainty import LARGEST_VOLTAGE_V, FieldBlock, Systematics
from femfit.tables.coil_record import COLUMNS, RAW, RAW_SUFFIXES, CoilBlock, CoilRecord


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
            table, first = (
                pd.DataFrame({name: block[name] for name in self.columns}),
                self._rows == len(block["time_s"]),
            )
            table.to_csv(self._file, index=False, header=first, float_format="%.10g")
        elif self._file is not None:
            self._file.write(self._evenly_spaced(block).astype(RAW).tobytes())

    def _evenly_spaced(self, block: Mapping[str, FloatArray]) -> FloatArray:
        """The rows of a raw record, with NaN for each sample that a gap of the clock left out."""
        time = block["time_s"]
        values = np.stack([block[name] for name in self.columns[1:]], axis=1)
        steps = np.diff(time, prepend=time[0] - self.sample_time if np.isnan(self._last) else self._last)
        places = np.cumsum(np.maximum(np.rint(steps / self.sample_time), 1.0)).astype(np.intp) - 1
        self._last = float(time[-1])
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


@dataclass(frozen=True, eq=False)
class Streamed:
    """What is left when a record has streamed past: its last block, and the rows where they were not written."""

    last: FieldBlock
    samples: int
    sample_time: float
    systematics: Systematics  # That are left at the end
    findings: tuple[Finding, ...]
    rows: pd.DataFrame | None


def stream_record(
    source: CoilRecord | pd.DataFrame,
    columns: tuple[str, ...],
    options: IntegrationOptions,
    current_field: CurrentField,
    systematics: tuple[Systematics, Systematics],
    quantity: str,
    *,
    output: Path | None,
    progress: Callable[[int, int], None] | None,
) -> Streamed:
    """Integrate a record block by block; its columns stand beside the result.

    Systematics are those before and those after an offset voltage was taken off.
    """
    blocks = map(_plausible, [_block(source)] if isinstance(source, pd.DataFrame) else source.blocks())
    total = len(source) if isinstance(source, pd.DataFrame) else source.samples
    show = progress if progress is not None and total else lambda _done, _total: None
    first = next(blocks)
    integrator = make_integrator(options, first)
    pairs = integrate_blocks(integrator, itertools.chain([first], blocks))
    watch = _watch(options, columns, quantity, integrator.sample_time, current_field)
    show(0, total or 0)
    samples, corrected = 0, False
    value, unit = quantity.rsplit("_", 1)
    sigma_name = f"{value}_sigma_{unit}"
    names = ["time_s", *columns, quantity, sigma_name, "offset_V"]
    blocks_read: list[pd.DataFrame] = []
    with nullcontext() if output is None else RecordWriter(output, names, integrator.sample_time) as writer:
        for block, out in pairs:
            read = {"coil_voltage_V": block.voltage, "hall_T": block.hall, "current_A": block.current}
            taken_off = np.logical_or.accumulate(out.offset != 0.0) | corrected
            sigma = np.where(taken_off, out.sigma(systematics[1]), out.sigma(systematics[0]))
            table = {"time_s": block.time} | {name: there for name in columns if (there := read[name]) is not None}
            table |= {quantity: out.field, sigma_name: sigma, "offset_V": out.offset}
            if writer is None:
                blocks_read.append(pd.DataFrame(table))
            else:
                writer.write(table)
            watch.see(block, out)
            samples, corrected = samples + len(block), bool(taken_off[-1])
            show(samples, total or 0)
        length = float(out.time[-1] - first.time[0])
        if options.zero_reading is not None and length <= options.zero_reading:
            raise TableError(
                f"The zero reading must end before the record does; instead it lasts {options.zero_reading:g} s, and "
                f"the record {length:.3g} s. Give a smaller --zero-reading-s."
            )
    findings = watch.findings()
    if options.method == "ffa2" and not corrected:
        findings = (*findings, finding("plateau", still_A=options.still_A))
    rows = pd.concat(blocks_read, ignore_index=True) if blocks_read else None
    return Streamed(out, samples, integrator.sample_time, systematics[corrected], findings, rows)


def _watch(
    options: IntegrationOptions,
    columns: tuple[str, ...],
    quantity: str,
    sample_time: float,
    current_field: CurrentField,
) -> RecordWatch:
    """Compare the coil with the reference that the method uses, or with one that the record has besides."""
    of_hall = options.method == "cs1-offset" or (options.method in FEED_FORWARD and "hall_T" in columns)
    reference: Reference | None = "hall_T" if of_hall else "current_A" if "current_A" in columns else None
    scale = None if current_field.ratio is None else 1.0 / current_field.ratio
    if of_hall and quantity == "field_T":
        scale = 1.0
    return RecordWatch(options.coil.area_m2, sample_time, reference, scale, current_field.currents)


def _block(rows: pd.DataFrame) -> CoilBlock:
    missing = [name for name in ("time_s", "coil_voltage_V") if name not in rows]
    if missing:
        raise TableError(f"A coil record needs {' and '.join(missing)}; the table has {', '.join(map(str, rows))}.")
    columns: dict[str, FloatArray] = {}
    for name in ("time_s", *COLUMNS):
        if name in rows:
            try:
                columns[name] = rows[name].to_numpy(dtype=np.float64, na_value=np.nan)
            except (TypeError, ValueError) as error:
                raise TableError(f"Column {name} of a coil record must hold numbers; {error}.") from error
    time_s, voltage = columns["time_s"], columns["coil_voltage_V"]
    read = np.isfinite(time_s) & np.isfinite(voltage)
    block = CoilBlock(time_s, voltage, columns.get("hall_T"), columns.get("current_A"))[read]
    if len(block) == 0 or np.any(np.diff(block.time) <= 0.0):
        raise TableError("A coil record must have a rising time_s; repair the clock, or give each stretch on its own.")
    return block


def _plausible(block: CoilBlock) -> CoilBlock:
    """The block with readings that are no number left out; a voltage that no coil has is refused."""
    highest = float(np.abs(block.voltage).max())
    if highest > LARGEST_VOLTAGE_V:
        raise TableError(
            f"A coil's voltage must stay below {LARGEST_VOLTAGE_V:g} V; instead received {highest:.3g} V. Check the "
            "column and its unit."
        )
    hall, current = (
        None if column is None else np.where(np.isfinite(column), column, np.nan)
        for column in (block.hall, block.current)
    )
    return CoilBlock(block.time, block.voltage, hall, current)
