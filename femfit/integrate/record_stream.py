"""A coil record streamed through an integrator: its rows kept or written, and what is wrong with it found.

It is written block by block, as CSV or Parquet.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from femfit.core.errors import TableError
from femfit.core.files import replacing
from femfit.core.numerics import FloatArray
from femfit.core.results import Finding
from femfit.integrate.methods import FEED_FORWARD, IntegrationOptions, integrate_blocks, make_integrator
from femfit.integrate.record_watch import RecordWatch, Reference, finding
from femfit.integrate.uncertainty import FieldBlock, Systematics
from femfit.tables.coil_record import COLUMNS, CoilBlock, CoilRecord

Table = Mapping[str, FloatArray]


@contextmanager
def record_writer(path: Path, columns: Sequence[str]) -> Iterator[Callable[[Table], None]]:
    """What writes columns block by block to a .csv or .parquet file, which appears when all is written."""
    if path.suffix not in {".csv", ".parquet"}:
        raise TableError(f"An integrated record is written as .csv or .parquet; instead received {path.name}.")
    with replacing(path) as partial:
        if path.suffix == ".parquet":
            schema = pa.schema([(name, pa.float64()) for name in columns])
            with pq.ParquetWriter(partial, schema) as parquet:
                yield lambda table: parquet.write_table(pa.table(dict(table), schema))
        else:
            with partial.open("wb") as file:
                yield lambda table: pd.DataFrame(table).to_csv(
                    file, index=False, header=file.tell() == 0, float_format="%.10g"
                )


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
    ratio: float | None,
    systematics: tuple[Systematics, Systematics],
    quantity: str,
    *,
    output: Path | None,
    progress: Callable[[int, int], None] | None,
) -> Streamed:
    """Integrate a record block by block; its columns stand beside the result.

    The ratio in A/T is that of a current to its field, where it is given; systematics are those before and those after
    an offset voltage was taken off.
    """
    blocks = map(_finite, [_block(source)] if isinstance(source, pd.DataFrame) else source.blocks())
    total = len(source) if isinstance(source, pd.DataFrame) else source.samples
    show = progress if progress is not None and total else lambda _done, _total: None
    first = next(blocks)
    integrator = make_integrator(options, first)
    pairs = integrate_blocks(integrator, itertools.chain([first], blocks))
    # The coil is compared with the reference that the method uses, or with one that the record has besides
    of_hall = options.method == "cs1-offset" or (options.method in FEED_FORWARD and "hall_T" in columns)
    reference: Reference | None = "hall_T" if of_hall else "current_A" if "current_A" in columns else None
    scale = None if ratio is None else 1.0 / ratio
    if of_hall and quantity == "field_T":
        scale = 1.0
    watch = RecordWatch(options.coil.area_m2, integrator.sample_time, reference, scale)
    show(0, total or 0)
    samples, corrected = 0, False
    value, unit = quantity.rsplit("_", 1)
    sigma_name = f"{value}_sigma_{unit}"
    names = ["time_s", *columns, quantity, sigma_name, "offset_V"]
    blocks_read: list[pd.DataFrame] = []
    with nullcontext() if output is None else record_writer(output, names) as write:
        for block, out in pairs:
            read = {"coil_voltage_V": block.voltage, "hall_T": block.hall, "current_A": block.current}
            taken_off = np.logical_or.accumulate(out.offset != 0.0) | corrected
            sigma = np.where(taken_off, out.sigma(systematics[1]), out.sigma(systematics[0]))
            table = {"time_s": block.time} | {name: there for name in columns if (there := read[name]) is not None}
            table |= {quantity: out.field, sigma_name: sigma, "offset_V": out.offset}
            if write is None:
                blocks_read.append(pd.DataFrame(table))
            else:
                write(table)
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


def _finite(block: CoilBlock) -> CoilBlock:
    """The block with readings that are no number left out."""
    hall, current = (
        None if column is None else np.where(np.isfinite(column), column, np.nan)
        for column in (block.hall, block.current)
    )
    return CoilBlock(block.time, block.voltage, hall, current)
