"""From a coil's record to its field or flux linkage: read, integrate, watch and write, block by block."""

import itertools
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.core.finding import Finding
from femfit.core.outputs import FIELD_MODEL, INTEGRATED, RAW_SIDECAR, require_outputs
from femfit.integrate.coil_integral import CoilIntegral
from femfit.integrate.constants import (
    LARGEST_VOLTAGE_V,
    OFFSET_SIGMA_V,
    SETTLING_S,
    STILL_A,
)
from femfit.integrate.field_of_current import FieldModel, field_of_ratio, read_field_model, write_field_model
from femfit.integrate.identified_field import field_of_lab_record, field_of_swept_model
from femfit.integrate.methods import (
    FEED_FORWARD,
    FILTERS,
    IntegrationOptions,
    Method,
    integrate_blocks,
    make_integrator,
)
from femfit.integrate.offset_filter import OffsetFilter
from femfit.integrate.record_watch import RecordWatch, Reference
from femfit.integrate.smoother import smooth as smoothed
from femfit.integrate.uncertainty import FieldBlock, LinearSigma, SensingCoil, Systematics
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import read_model
from femfit.tables.coil_block import CoilBlock, joined_record
from femfit.tables.coil_record import COLUMNS, RAW_SUFFIXES, CoilRecord, open_coil_record
from femfit.tables.record_writer import RecordWriter

USED_BY = {
    "--zero-reading-s": ("ffa1",),
    "--settling-s": ("ffa2",),
    "--still-A": ("ffa2",),
    "--current-to-field": ("cs2",),
    "--lab": ("cs2-identified",),
    "--field-model": ("cs2-identified",),
    "--model": ("cs2-identified",),
    "--smooth": FILTERS,
    "--reference-gain-sigma": FILTERS,
    "--reference-offset-sigma-T": FILTERS,
}
"""Options that not every method uses, with those that do."""


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
    field_model: str | Path | FieldModel | None = None,
    model: str | Path | ActuatorModel | None = None,
    distance_m: float | None = None,
    model_sigma: float | None = None,
    smooth: bool = False,
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
    method : str
        ``trapezoid``; ``ffa1`` (offset from a zero reading); ``ffa2`` (mean on each plateau); ``cs1-offset`` (Kalman
        filter with a Hall probe, whose second state is the offset voltage); ``cs2``, ``cs2-identified`` (the same with
        the current over a ratio, with a field model). Default: ``cs1-offset`` where the record has a Hall probe and an
        area is given, else ``ffa2``.
    coil_area_m2 : float
        Total area of the coil; filters with a Hall probe or a ratio need it.
    output : path
        File for the rows, .csv, .parquet, .bin, .raw or .f32; without it they stay in the result.
    initial_field_T : float
        Field at the record's begin (flux linkage without an area); default 0, or the reference's first reading.
    zero_reading_s, settling_s, still_A : float
        Length of ffa1's zero reading; time that ffa2 waits after a ramp (1 s by default); how far a current may move
        in a second of a plateau (0.1 A).
    current_to_field_A_per_T : float
        Of cs2.
    lab, field_model : path
        Of cs2-identified: a record with Hall probe and current to identify the field from, and the file of the
        identified field, written with ``lab`` and read without.
    model, distance_m, model_sigma : path or model, float, float
        Of cs2-identified: a femfit model whose swept field takes the place of an identified one, at which distance,
        and what it is believed to be off by (1 % of its largest field by default).
    smooth : bool
        Let the whole record speak for every sample (Rauch, Tung and Striebel); needs all of it in memory.
    coil_area_sigma_m2, reference_gain_sigma, reference_offset_sigma_T, offset_sigma_V : float
        Standard uncertainties of what stays the same through the record; the gain's is relative.
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
    begin = time.perf_counter()
    output = None if output is None else Path(output)
    if isinstance(record, pd.DataFrame):
        source: CoilRecord | pd.DataFrame = record
    else:
        source = open_coil_record(Path(record), columns=columns, units=units, table=table)
    recorded = tuple(name for name in COLUMNS if name in source.columns)
    chosen: Method = method or ("cs1-offset" if coil_area_m2 is not None and "hall_T" in recorded else "ffa2")
    given = {
        "--coil-area": coil_area_m2,
        "--zero-reading-s": zero_reading_s,
        "--settling-s": settling_s,
        "--still-A": still_A,
        "--current-to-field": current_to_field_A_per_T,
        "--lab": lab,
        "--field-model": field_model,
        "--model": model,
        "--distance-mm": distance_m,
        "--model-sigma": model_sigma,
        "--smooth": smooth or None,
        "--coil-area-sigma": coil_area_sigma_m2,
        "--reference-gain-sigma": reference_gain_sigma,
        "--reference-offset-sigma-T": reference_offset_sigma_T,
    }
    _require_fitting(chosen, {option for option, value in given.items() if value is not None})
    written = Path(field_model) if lab is not None and isinstance(field_model, str | Path) else None
    _require_free([record, lab, model, field_model if lab is None else None], output, written)
    coil = SensingCoil(1.0 if coil_area_m2 is None else coil_area_m2)
    known = _CurrentField()
    if current_to_field_A_per_T is not None:
        known = _of_ratio(current_to_field_A_per_T, reference_gain_sigma, reference_offset_sigma_T)
    elif model is not None and distance_m is not None:
        swept = model if isinstance(model, ActuatorModel) else read_model(Path(model))
        field_, currents = field_of_swept_model(swept, distance_m, of_flux=coil_area_m2 is None, sigma=model_sigma)
        known = _CurrentField(field_, currents)
    elif chosen == "cs2-identified":
        known = _identified(coil, lab, field_model)
    if written is not None and known.model is not None:
        write_field_model(known.model, written)
    systematics = Systematics(
        (coil_area_sigma_m2 or 0.0) / coil.area_m2,
        reference_gain_sigma or 0.0,
        max(reference_offset_sigma_T or 0.0, known.model.rms_T if chosen == "cs2-identified" and known.model else 0.0),
        OFFSET_SIGMA_V.get(chosen, 0.0) if offset_sigma_V is None else offset_sigma_V,
    )
    options = IntegrationOptions(
        chosen,
        coil,
        initial_field_T,
        zero_reading_s,
        SETTLING_S if settling_s is None else settling_s,
        STILL_A if still_A is None else still_A,
        known.model,
        known.sigma,
    )
    quantity = "flux_linkage_Wb" if coil_area_m2 is None else "field_T"
    before = systematics  # Until ffa2 takes an offset off, all of the amplifier's is left
    if chosen == "ffa2" and offset_sigma_V is None:
        before = replace(systematics, offset_voltage_V=OFFSET_SIGMA_V["trapezoid"])
    made = _stream(source, recorded, options, known, (before, systematics), quantity, smooth, output, progress)
    end = made.last
    if not made.corrected:
        systematics = before
    parts = {name: float(values[-1]) for name, values in end.responses.parts(systematics).items()}
    return CoilIntegral(
        record="a table" if isinstance(source, pd.DataFrame) else str(source.path),
        method=chosen,
        smoothed=smooth,
        quantity=quantity,
        samples=made.samples,
        sample_time_s=made.sample_time,
        end_s=float(end.time[-1]),
        value=float(end.field[-1]),
        standard_uncertainty=float(end.sigma(systematics)[-1]),
        coverage=coverage,
        parts={"noise": float(np.sqrt(end.variance[-1])), **parts},
        offset_V=float(end.offset[-1]),
        findings=made.findings,
        output=output,
        field_model=written,
        rows=made.rows,
        seconds=time.perf_counter() - begin,
    )


def _require_fitting(method: Method, given: set[str]) -> None:
    """Refuse options that would do nothing, and say what a method lacks."""
    for option in sorted(given & USED_BY.keys()):
        if method not in USED_BY[option]:
            raise TableError(
                f"{option} is for {' and '.join(USED_BY[option])}; {method} does not use it. Leave it out, or give "
                "another --method."
            )
    if "--model" in given and ("--distance-mm" not in given or given & {"--lab", "--field-model"}):
        raise TableError("--model goes with --distance-mm, without --lab and --field-model.")
    for option, partner in (
        ("--distance-mm", "--model"),
        ("--model-sigma", "--model"),
        ("--coil-area-sigma", "--coil-area"),
    ):
        if option in given and partner not in given:
            raise TableError(f"{option} belongs to {partner} and does nothing without it. Give both, or neither.")
    if method in FILTERS and not given & {"--coil-area", "--model"}:
        raise TableError(f"{method} compares a coil with a field and needs the coil's area: give --coil-area in m2.")
    if method == "cs2" and "--current-to-field" not in given:
        raise TableError(
            "cs2 takes the current over the magnet's current-to-field ratio for a field: give that ratio in A/T with "
            "--current-to-field."
        )


@dataclass(frozen=True, eq=False)
class _CurrentField:
    """What is known of the field of a current: a model, the currents in A between which it holds, a ratio's error."""

    model: FieldModel | None = None
    currents: tuple[float, float] | None = None
    sigma: LinearSigma | None = None
    ratio: float | None = None


def _of_ratio(ratio: float, gain_sigma: float | None, offset_sigma: float | None) -> _CurrentField:
    sigma = LinearSigma(offset_sigma or 0.0, gain_sigma or 0.0)
    return _CurrentField(field_of_ratio(ratio, sigma.floor), None, sigma, ratio)


def _identified(coil: SensingCoil, lab: str | Path | None, given: str | Path | FieldModel | None) -> _CurrentField:
    if lab is None and given is None:
        raise TableError(
            "cs2-identified needs what field belongs to a current: give --lab RECORD (with hall_T and current_A, of a "
            "magnet that was cycled before), --field-model FILE, or --model MODEL.json with --distance-mm."
        )
    if lab is not None:
        model = field_of_lab_record(lab, coil.area_m2)
    else:
        model = given if isinstance(given, FieldModel) else read_field_model(Path(str(given)))
    return _CurrentField(model, (0.0, model.terms.current_max_A))


@dataclass(frozen=True, eq=False)
class _Streamed:
    """What is left when a record has streamed past: its last block, and the rows where they were not written."""

    last: FieldBlock
    samples: int
    sample_time: float
    corrected: bool  # Whether an offset voltage was taken off
    findings: tuple[Finding, ...]
    rows: pd.DataFrame | None


def _stream(
    source: CoilRecord | pd.DataFrame,
    columns: tuple[str, ...],
    options: IntegrationOptions,
    known: _CurrentField,
    systematics: tuple[Systematics, Systematics],
    quantity: str,
    smooth: bool,
    output: Path | None,
    progress: Callable[[int, int], None] | None,
) -> _Streamed:
    blocks = map(_plausible, [_block(source)] if isinstance(source, pd.DataFrame) else source.blocks())
    total = len(source) if isinstance(source, pd.DataFrame) else source.samples
    first = next(blocks)
    integrator = make_integrator(options, first)
    pairs = integrate_blocks(integrator, itertools.chain([first], blocks))
    if smooth and isinstance(integrator, OffsetFilter):
        whole = joined_record(itertools.chain([first], blocks))
        pairs = iter([(whole, smoothed(integrator, whole))])
    watch = _watch(options, columns, quantity, integrator.sample_time, known)
    if progress is not None and total:
        progress(0, total)
    samples, corrected = 0, False
    value, unit = quantity.rsplit("_", 1)
    sigma_name = f"{value}_sigma_{unit}"
    names = ["time_s", *columns, quantity, sigma_name, "offset_V"]
    kept: list[pd.DataFrame] = []
    with nullcontext() if output is None else RecordWriter(output, names, integrator.sample_time) as writer:
        for block, out in pairs:
            read = {"coil_voltage_V": block.voltage, "hall_T": block.hall, "current_A": block.current}
            table = {"time_s": block.time} | {name: there for name in columns if (there := read[name]) is not None}
            taken_off = np.logical_or.accumulate(out.offset != 0.0) | corrected
            sigma = np.where(taken_off, out.sigma(systematics[1]), out.sigma(systematics[0]))
            table |= {quantity: out.field, sigma_name: sigma, "offset_V": out.offset}
            if writer is None:
                kept.append(pd.DataFrame(table))
            else:
                writer.write(table)
            watch.see(block, out)
            samples += len(block)
            corrected |= bool(np.any(out.offset != 0.0))
            if progress is not None and total:
                progress(samples, total)
        length = float(out.time[-1] - first.time[0])
        if options.method == "ffa1" and options.zero_reading is not None and length <= options.zero_reading:
            raise TableError(
                f"The zero reading must end before the record does; instead it lasts {options.zero_reading:g} s, and "
                f"the record {length:.3g} s. Give a smaller --zero-reading-s."
            )
    findings = watch.findings()
    if options.method == "ffa2" and not corrected:
        text = (
            f"ffa2 found no settled plateau, on which the current moves by less than {options.still_A:g} A in a "
            "second: nothing was taken off, and this is the plain integral."
        )
        remedy = "Give --still-A, a shorter --settling-s, or another method."
        findings += (Finding("plateau", "warning", text, remedy),)
    rows = pd.concat(kept, ignore_index=True) if kept else None
    return _Streamed(out, samples, integrator.sample_time, corrected, findings, rows)


def _watch(
    options: IntegrationOptions, columns: tuple[str, ...], quantity: str, sample_time: float, known: _CurrentField
) -> RecordWatch:
    """Compare the coil with the reference that the method uses, or with one that the record has besides."""
    of_hall = options.method == "cs1-offset" or (options.method in FEED_FORWARD and "hall_T" in columns)
    reference: Reference | None = "hall_T" if of_hall else "current_A" if "current_A" in columns else None
    scale = None if known.ratio is None else 1.0 / known.ratio
    if of_hall and quantity == "field_T":
        scale = 1.0
    return RecordWatch(options.coil.area_m2, sample_time, reference, scale, known.currents)


def _require_free(read: list[Any], output: Path | None, field_model: Path | None) -> None:
    """Refuse results that would replace what is read, or a file of another kind."""
    inputs = [Path(path) for path in read if isinstance(path, str | Path)]
    raw = [path for path in inputs if path.suffix in RAW_SUFFIXES]
    sidecars = [path.with_suffix(suffix) for path in raw for suffix in (".toml", ".json")]
    sidecar = output.with_suffix(".json") if output is not None and output.suffix in RAW_SUFFIXES else None
    require_outputs([*inputs, *sidecars], (output, INTEGRATED), (sidecar, RAW_SIDECAR), (field_model, FIELD_MODEL))


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

    def known(column: FloatArray | None) -> FloatArray | None:
        return None if column is None else np.where(np.isfinite(column), column, np.nan)

    return CoilBlock(block.time, block.voltage, known(block.hall), known(block.current))
