"""From a coil's record to its field or flux linkage: what a method needs, and how sure the result is."""

import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from femfit.core.errors import TableError
from femfit.core.files import INTEGRATED, finite_number, replacing, require_outputs
from femfit.core.numerics import LARGEST
from femfit.core.public import require_known
from femfit.core.text import quoted
from femfit.integrate.feed_forward import SETTLING_S, STILL_A
from femfit.integrate.field_of_current import (
    PATH_INTERVAL,
    FieldModel,
    LabRun,
    field_of_ratio,
    identify_field,
    stepped_means,
)
from femfit.integrate.methods import (
    FEED_FORWARD,
    FILTERS,
    CoilIntegral,
    IntegrationOptions,
    Method,
    integrate_blocks,
    make_integrator,
)
from femfit.integrate.record_watch import RecordWatch, Reference, finding
from femfit.integrate.uncertainty import LinearSigma, SensingCoil, Systematics
from femfit.tables.coil_record import RAW_SUFFIXES, CoilRecord, open_coil_record

OFFSET_SIGMA_V = {"trapezoid": 20e-6, "ffa1": 5e-6, "ffa2": 5e-6, **dict.fromkeys(FILTERS, 0.0)}
"""Standard uncertainty of the offset voltage that a method leaves. Chosen: 20 uV for an amplifier's own offset, 5 uV
for what wanders after it was measured; the filters estimate it."""

_OPTIONS: dict[str, tuple[str, tuple[str, ...], str]] = {
    "coil_area_m2": ("--coil-area", (), ""),
    "initial_field_T": ("--initial-field-T", (), ""),
    "zero_reading_s": ("--zero-reading-s", ("ffa1",), " > 0"),
    "settling_s": ("--settling-s", ("ffa2",), " >= 0"),
    "still_A": ("--still-A", ("ffa2",), " > 0"),
    "current_to_field_A_per_T": ("--current-to-field", ("cs2",), " > 0"),
    "coil_area_sigma_m2": ("--coil-area-sigma", (), " >= 0"),
    "reference_gain_sigma": ("--reference-gain-sigma", FILTERS, " >= 0"),
    "reference_offset_sigma_T": ("--reference-offset-sigma-T", FILTERS, " >= 0"),
    "offset_sigma_V": ("--offset-sigma-uV", (), " >= 0"),
    "coverage": ("--coverage", (), " > 0"),
    "lab": ("--lab", ("cs2-identified",), "path"),
}
"""By keyword: the option, the methods that use it, all where none is named, and which numbers it may be."""

_LEAST = {"": -LARGEST, " >= 0": 0.0, " > 0": 1.0 / LARGEST}


def integrate_coil(
    record: str | Path | pd.DataFrame,
    *,
    method: Method | None = None,
    coil_area_m2: float | None = None,
    output: str | Path | None = None,
    initial_field_T: float | None = None,
    zero_reading_s: float | None = None,
    settling_s: float | None = None,
    still_A: float | None = None,
    current_to_field_A_per_T: float | None = None,
    lab: str | Path | None = None,
    coil_area_sigma_m2: float | None = None,
    reference_gain_sigma: float | None = None,
    reference_offset_sigma_T: float | None = None,
    offset_sigma_V: float | None = None,
    coverage: float = 2.0,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    table: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> CoilIntegral:
    """Integrate a coil's voltage to its field (or, without an area, its flux linkage), and say how sure that is.

    Parameters
    ----------
    record : path or DataFrame
        ``time_s``, ``coil_voltage_V``, and ``hall_T`` or ``current_A`` for a filter.
    method : {'trapezoid', 'ffa1', 'ffa2', 'cs1-offset', 'cs2', 'cs2-identified'} or None
        Method of integration: trapezoid; ffa1 (offset from an initial zero reading); ffa2 (mean on each plateau);
        cs1-offset (Kalman filter with a Hall probe, whose second state is the offset voltage); cs2, cs2-identified (the
        same with the current, by a ratio, by a field identified from ``lab``); by default cs1-offset where the record
        has a Hall probe and an area is given, else ffa2.
    coil_area_m2 : float or None
        Total area of the coil in m2, which the filters need.
    output : path
        File for the rows, .csv or .parquet; without it they stay in the result.
    initial_field_T : float or None
        Field at the record's begin (flux linkage in Wb without an area); 0 by default, or the reference's first
        reading.
    zero_reading_s : float > 0 or None
        Time at the record's begin in which nothing moves, for the zero reading of ffa1.
    settling_s : float >= 0 or None
        Time left out after each ramp until the eddy currents have decayed, for ffa2; 1 s by default.
    still_A : float > 0 or None
        Largest change of the current within a second on a plateau of ffa2; 0.1 A by default.
    current_to_field_A_per_T : float > 0 or None
        Ratio of the magnet's current to its field in A/T for cs2, as sure as ``reference_gain_sigma`` says.
    lab : str, Path or None
        Record with Hall probe and current of a cycled magnet, from which cs2-identified identifies its field.
    coil_area_sigma_m2 : float >= 0 or None
        Standard uncertainty of the area in m2.
    reference_gain_sigma : float >= 0 or None
        Relative standard uncertainty of the gain of the Hall probe, or of the current-to-field ratio.
    reference_offset_sigma_T : float >= 0 or None
        Standard uncertainty of the reference's zero.
    offset_sigma_V : float >= 0 or None
        Standard uncertainty of the offset voltage that a method leaves; by default 20 µV (trapezoid), 5 µV (ffa1, ffa2)
        and 0 (the filters, which estimate it).
    coverage : float > 0
        Coverage factor of the printed uncertainty.
    columns, units, table : optional
        What the record's columns are and in which unit, and which table of its file it is, as in
        :func:`femfit.read_measurement`.
    progress : callable
        Called with samples done and in all, where the record says how many there are.

    Raises
    ------
    TableError
        If the record or the options lack what the method needs.
    OutputError
        If a file that is read, or one of another kind, would be replaced.

    Examples
    --------
    >>> import numpy as np, pandas as pd, femfit as ff
    >>> time = np.arange(0.0, 2.0, 1e-3)
    >>> rows = pd.DataFrame({"time_s": time, "coil_voltage_V": 0.05 * np.cos(time)})
    >>> flux = ff.integrate_coil(rows, method="trapezoid")
    >>> round(flux.value, 4)  # 0.05 sin(2)
    0.0455
    """
    arguments, begin = locals(), time.perf_counter()
    output = None if output is None else Path(output)
    source = open_coil_record(record, columns=columns, units=units, table=table)
    chosen: Method = method or ("cs1-offset" if coil_area_m2 is not None and "hall_T" in source.columns else "ffa2")
    _require_fitting(chosen, arguments)
    inputs = [Path(path) for path in (record, lab) if isinstance(path, str | Path)]
    raw = [path for path in inputs if path.suffix in RAW_SUFFIXES]
    sidecars = [path.with_suffix(suffix) for path in raw for suffix in (".toml", ".json")]
    require_outputs([*inputs, *sidecars], (output, INTEGRATED))
    coil = SensingCoil(1.0 if coil_area_m2 is None else coil_area_m2)
    field_model, offset_sigma, reference_sigma = None, reference_offset_sigma_T or 0.0, None
    if current_to_field_A_per_T is not None:
        reference_sigma = LinearSigma(offset_sigma, reference_gain_sigma or 0.0)
        field_model = field_of_ratio(current_to_field_A_per_T, offset_sigma)
    elif lab is not None:
        field_model = field_of_lab_record(lab, coil)
        offset_sigma = max(offset_sigma, field_model.rms_T)
    options = IntegrationOptions(
        chosen,
        coil,
        initial_field_T,
        zero_reading_s,
        SETTLING_S if settling_s is None else settling_s,
        STILL_A if still_A is None else still_A,
        field_model,
        reference_sigma,
    )
    gains = (coil_area_sigma_m2 or 0.0) / coil.area_m2, reference_gain_sigma or 0.0
    # Until ffa2 takes an offset off, all of the amplifier's is left
    offsets = OFFSET_SIGMA_V["trapezoid" if chosen == "ffa2" else chosen], OFFSET_SIGMA_V[chosen]
    offsets = offsets if offset_sigma_V is None else (offset_sigma_V, offset_sigma_V)
    before, after = (Systematics(*gains, offset_sigma, offset) for offset in offsets)
    quantity = "flux_linkage_Wb" if coil_area_m2 is None else "field_T"
    result = stream_record(
        source, options, current_to_field_A_per_T, (before, after), quantity, coverage, output, progress
    )
    return replace(result, seconds=time.perf_counter() - begin)


def _require_fitting(method: Method, arguments: Mapping[str, Any]) -> None:
    """Refuse options that would do nothing, and say what a method lacks."""
    require_known("method", [method], OFFSET_SIGMA_V)
    options = {entry[0]: arguments[keyword] for keyword, entry in _OPTIONS.items() if arguments[keyword] is not None}
    for option, methods, bound in (entry for entry in _OPTIONS.values() if entry[0] in options):
        number = finite_number(options[option])
        if bound != "path" and (number is None or not _LEAST[bound] <= number < LARGEST):
            limits = f"{bound}, from {_LEAST[bound]:g} to {LARGEST:g}"
            raise TableError(f"{option} must be a number{limits}; instead received {quoted(options[option])}.")
        if methods and method not in methods:
            raise TableError(
                f"{option} is for {' and '.join(methods)}; {method} does not use it. Leave it out, or give another "
                "--method."
            )
    if method in FILTERS and "--coil-area" not in options:
        raise TableError(f"{method} compares a coil with a field and needs the coil's area: give --coil-area in m2.")
    if method == "cs2" and "--current-to-field" not in options:
        raise TableError(
            "cs2 takes the current over the magnet's current-to-field ratio for a field: give that ratio in A/T with "
            "--current-to-field."
        )
    if method == "cs2-identified" and "--lab" not in options:
        raise TableError(
            "cs2-identified needs what field belongs to a current: give --lab RECORD (with hall_T and current_A, of a "
            "magnet that was cycled before)."
        )


def field_of_lab_record(lab: str | Path, coil: SensingCoil) -> FieldModel:
    """Identify the field of a magnet that was cycled before, from a record of coil, Hall probe and current."""
    record = open_coil_record(Path(lab))
    if not {"hall_T", "current_A"} <= set(record.columns):
        raise TableError(f"A lab record needs hall_T and current_A; {record.source} has {', '.join(record.columns)}.")
    blocks = record.blocks()
    first = next(blocks)
    integrator = make_integrator(IntegrationOptions("cs1-offset", coil), first)
    step = max(1, round(PATH_INTERVAL / integrator.sample_time))
    parts = [
        np.stack(
            [stepped_means(column, step) for column in (block.time, block.current, out.field) if column is not None]
        )
        for block, out in integrate_blocks(integrator, itertools.chain([first], blocks))
    ]
    return identify_field([LabRun(*np.concatenate(parts, axis=1))])


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
        record=source.source,
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
        findings=(*source.findings, *watch.findings(), *lacking),
        rows=pd.concat(tables, ignore_index=True) if tables else None,
    )
