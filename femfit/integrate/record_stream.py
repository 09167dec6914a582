"""A coil record streamed through an integrator: its rows kept or written, and what is wrong with it found.

It is written block by block, as CSV or Parquet.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from femfit.core.errors import TableError
from femfit.core.files import replacing
from femfit.integrate.methods import (
    FEED_FORWARD,
    CoilIntegral,
    IntegrationOptions,
    integrate_blocks,
    make_integrator,
)
from femfit.integrate.record_watch import RecordWatch, Reference, finding
from femfit.integrate.uncertainty import Systematics
from femfit.tables.coil_record import COIL, CoilRecord
from femfit.tables.columns import UsedColumn


@contextmanager
def record_writer(path: Path, columns: Sequence[str]) -> Iterator[Callable[[pd.DataFrame], None]]:
    """What writes tables block by block to a .csv or .parquet file, which appears when all is written."""
    if path.suffix not in {".csv", ".parquet"}:
        raise TableError(f"An integrated record is written as .csv or .parquet; instead received {path.name}.")
    with replacing(path) as partial:
        if path.suffix == ".parquet":
            schema = pa.schema([(name, pa.float64()) for name in columns])
            with pq.ParquetWriter(partial, schema) as parquet:
                yield lambda table: parquet.write_table(pa.Table.from_pandas(table, schema, preserve_index=False))
        else:
            with partial.open("wb") as file:
                yield lambda table: table.to_csv(file, index=False, header=file.tell() == 0, float_format="%.10g")


def table_record(rows: pd.DataFrame) -> CoilRecord:
    """A table in memory as a record; its columns have the names and units of one."""
    used = tuple(UsedColumn(name, name, 1.0, "") for name in COIL.names if name in rows)
    COIL.require([column.name for column in used], map(str, rows), "the table", used)
    return CoilRecord(Path("a table"), used, len(rows), lambda _: iter([rows]))


def stream_record(
    source: CoilRecord,
    options: IntegrationOptions,
    ratio: float | None,
    systematics: tuple[Systematics, Systematics],
    quantity: str,
    coverage: float,
    output: Path | None,
    progress: Callable[[int, int], None] | None,
) -> CoilIntegral:
    """Integrate a record block by block; its columns stand beside the result.

    The ratio in A/T is that of a current to its field, where it is given; systematics are those before and those after
    an offset voltage was taken off.
    """
    blocks, total, columns = source.blocks(), source.samples or 0, source.columns
    show = progress if progress is not None and total else lambda _done, _total: None
    first = next(blocks)
    integrator = make_integrator(options, first)
    # The coil is compared with the reference that the method uses, or with one that the record has besides
    of_hall = options.method == "cs1-offset" or (options.method in FEED_FORWARD and "hall_T" in columns)
    reference: Reference | None = "hall_T" if of_hall else "current_A" if "current_A" in columns else None
    scale = None if ratio is None else 1.0 / ratio
    scale = 1.0 if of_hall and quantity == "field_T" else scale
    watch = RecordWatch(options.coil.area_m2, integrator.sample_time, reference, scale)
    show(0, total)
    samples, corrected = 0, False
    value, unit = quantity.rsplit("_", 1)
    sigma_name = f"{value}_sigma_{unit}"
    tables: list[pd.DataFrame] = []
    written = ["time_s", *columns, quantity, sigma_name, "offset_V"]
    with nullcontext(tables.append) if output is None else record_writer(output, written) as write:
        for block, out in integrate_blocks(integrator, itertools.chain([first], blocks)):
            read = {"coil_voltage_V": block.voltage, "hall_T": block.hall, "current_A": block.current}
            taken_off = np.logical_or.accumulate(out.offset != 0.0) | corrected
            sigma = np.where(taken_off, out.sigma(systematics[1]), out.sigma(systematics[0]))
            rows = {"time_s": block.time, **{name: read[name] for name in columns}, quantity: out.field}
            write(pd.DataFrame(rows | {sigma_name: sigma, "offset_V": out.offset}))
            watch.see(block, out)
            samples, corrected = samples + len(block), bool(taken_off[-1])
            show(samples, total)
        length = float(out.time[-1] - first.time[0])
        if options.zero_reading is not None and length <= options.zero_reading:
            raise TableError(
                f"The zero reading must end before the record does; instead it lasts {options.zero_reading:g} s, and "
                f"the record {length:.3g} s. Give a smaller --zero-reading-s."
            )
    lacking = (finding("plateau", still_A=options.still_A),) if options.method == "ffa2" and not corrected else ()
    at_the_end = systematics[corrected]
    parts = {name: float(values[-1]) for name, values in out.responses.parts(at_the_end).items()}
    return CoilIntegral(
        record=str(source.path),
        method=options.method,
        quantity=quantity,
        coverage=coverage,
        output=output,
        samples=samples,
        sample_time_s=integrator.sample_time,
        end_s=float(out.time[-1]),
        value=float(out.field[-1]),
        standard_uncertainty=float(out.sigma(at_the_end)[-1]),
        parts={"noise": float(np.sqrt(out.variance[-1])), **parts},
        offset_V=float(out.offset[-1]),
        findings=(*watch.findings(), *lacking),
        rows=pd.concat(tables, ignore_index=True) if tables else None,
    )
