"""From a coil's record to its field or flux linkage: read, integrate, watch and write, block by block."""

import itertools
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.core.finding import Finding
from femfit.core.outputs import FIELD_MODEL, RAW_SIDECAR, require_outputs
from femfit.integrate.constants import LARGEST_VOLTAGE_V, OFFSET_SIGMA_V, SETTLING_S
from femfit.integrate.field_block import FieldBlock
from femfit.integrate.field_of_current import FieldModel, read_field_model, write_field_model
from femfit.integrate.methods import (
    FEED_FORWARD,
    IntegrationOptions,
    Method,
    integrate_blocks,
    make_integrator,
)
from femfit.integrate.record_watch import RecordWatch, Reference
from femfit.integrate.reference_field import identified_field, swept_field
from femfit.integrate.smoother import smooth_blocks
from femfit.integrate.uncertainty import SensingCoil, Systematics
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import read_model
from femfit.tables.coil_block import CoilBlock
from femfit.tables.coil_record import COLUMNS, RAW_SUFFIXES, CoilRecord, RecordWriter, open_coil_record


@dataclass(frozen=True, eq=False)
class CoilIntegral:
    """What integrating a coil's voltage gave.

    Parameters
    ----------
    quantity : str
        ``field_T``, or ``flux_linkage_Wb`` without a coil area.
    value, standard_uncertainty : float
        At the record's end, in the quantity's unit.
    parts : dict
        Standard uncertainty at the end by source.
    offset_V : float
        Offset voltage that was taken off at the end.
    rows : DataFrame or None
        The record's columns with the quantity, its standard uncertainty and the offset; None where they were written.

    Examples
    --------
    >>> import femfit as ff
    >>> integral = ff.integrate_coil("record.csv", coil_area_m2=0.05)
    >>> round(1e6 * integral.offset_V), list(integral.rows)[-1]
    (10, 'offset_V')
    """

    record: str
    method: Method
    smoothed: bool
    quantity: str
    samples: int
    sample_time_s: float
    end_s: float
    value: float
    standard_uncertainty: float
    coverage: float
    parts: dict[str, float]
    offset_V: float
    findings: tuple[Finding, ...]
    output: Path | None
    field_model: Path | None
    rows: pd.DataFrame | None = field(repr=False, default=None)
    seconds: float = 0.0

    @property
    def expanded_uncertainty(self) -> float:
        """Coverage factor times standard uncertainty."""
        return self.coverage * self.standard_uncertainty

    def __str__(self) -> str:
        unit = self.quantity.rsplit("_", 1)[1]
        given = ", ".join(f"{name.replace('_', ' ')} {part:.3g}" for name, part in self.parts.items() if part > 0.0)
        none = [name.replace("_", " ") for name, part in self.parts.items() if part == 0.0]
        how = f"{self.method}, smoothed" if self.smoothed else self.method
        lines = [
            (
                f"{self.value:.9g} {unit} +- {self.expanded_uncertainty:.3g} {unit} (k = {self.coverage:g}) at "
                f"{self.end_s:.6g} s, the record's end"
            ),
            (
                f"{how}: {self.samples} samples, {1.0 / self.sample_time_s:.6g} Hz, offset voltage "
                f"{1e6 * self.offset_V:.3g} uV at the end"
            ),
            f"standard uncertainty in {unit}: {given}" + (f"; nothing given for {', '.join(none)}" if none else ""),
            *(f"{finding.code}: {finding}" for finding in self.findings),
            *(f"written: {path}" for path in (self.field_model, self.output) if path is not None),
        ]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready, without the rows."""
        return {
            "record": self.record,
            "method": self.method,
            "smoothed": self.smoothed,
            "quantity": self.quantity,
            "samples": self.samples,
            "sample_time_s": self.sample_time_s,
            "end": {
                "time_s": self.end_s,
                "value": self.value,
                "standard_uncertainty": self.standard_uncertainty,
                "expanded_uncertainty": self.expanded_uncertainty,
                "coverage_factor": self.coverage,
                "parts": self.parts,
                "offset_V": self.offset_V,
            },
            "findings": [finding.as_dict() for finding in self.findings],
            "output": None if self.output is None else str(self.output),
            "seconds": self.seconds,
        }


def integrate_coil(
    record: str | Path | pd.DataFrame,
    *,
    method: Method | None = None,
    coil_area_m2: float | None = None,
    output: str | Path | None = None,
    initial_field_T: float | None = None,
    zero_reading_s: float | None = None,
    settling_s: float = SETTLING_S,
    still_A: float = 0.1,
    current_to_field_A_per_T: float | None = None,
    lab: str | Path | None = None,
    field_model: str | Path | FieldModel | None = None,
    model: str | Path | ActuatorModel | None = None,
    distance_m: float | None = None,
    model_sigma: float | None = None,
    smooth: bool = False,
    coil_area_sigma_m2: float = 0.0,
    reference_gain_sigma: float = 0.0,
    reference_offset_sigma_T: float = 0.0,
    offset_sigma_V: float | None = None,
    coverage: float = 2.0,
    progress: Callable[[int, int], None] | None = None,
) -> CoilIntegral:
    """Integrate a coil's voltage to its field (or, without an area, its flux linkage), and say how sure that is.

    Parameters
    ----------
    record : path or DataFrame
        ``time_s``, ``coil_voltage_V``, and ``hall_T`` or ``current_A`` for a filter.
    method : str
        ``trapezoid``; ``ffa1`` (offset from a zero reading); ``ffa2`` (mean on each plateau); ``cs1``, ``cs2`` (Kalman
        filter with a Hall probe, with the current); ``cs1-offset`` (with the offset voltage as a second state);
        ``cs2-identified`` (with a field model). Default: ``cs1-offset`` where the record has a Hall probe and an area
        is given, else ``ffa2``.
    coil_area_m2 : float
        Total area of the coil; filters with a Hall probe or a ratio need it.
    output : path
        File for the rows, .csv, .parquet, .bin, .raw or .f32; without it they stay in the result.
    initial_field_T : float
        Field at the record's begin (flux linkage without an area); default 0, or the reference's first reading.
    zero_reading_s, settling_s, still_A : float
        Length of ffa1's zero reading; time that ffa2 waits after a ramp; how far a current may move in a second of a
        plateau.
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
    progress : callable
        Called with samples done and in all.

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
    source = record if isinstance(record, pd.DataFrame) else open_coil_record(Path(record))
    columns = tuple(name for name in COLUMNS if name in source.columns)
    chosen: Method = method or ("cs1-offset" if coil_area_m2 is not None and "hall_T" in columns else "ffa2")
    if coil_area_m2 is None and chosen not in FEED_FORWARD and model is None:
        raise TableError(f"{chosen} compares a coil with a field and needs the coil's area: give --coil-area in m2.")
    if chosen != "cs2-identified" and (lab is not None or field_model is not None):
        raise TableError(
            f"--lab and --field-model describe the field of a current for --method cs2-identified; {chosen} uses none. "
            "Leave them out, or give that method."
        )
    written = Path(field_model) if lab is not None and isinstance(field_model, str | Path) else None
    _require_free([record, lab, model, field_model if lab is None else None], output, written)
    coil = SensingCoil(1.0 if coil_area_m2 is None else coil_area_m2, coil_area_sigma_m2)
    known: FieldModel | None = None
    currents = None
    if model is not None:
        if chosen != "cs2-identified" or lab is not None or field_model is not None or distance_m is None:
            raise TableError(
                "--model goes with --method cs2-identified and --distance-mm, without --lab and --field-model."
            )
        swept = model if isinstance(model, ActuatorModel) else read_model(Path(model))
        known, currents = swept_field(swept, distance_m, of_flux=coil_area_m2 is None, sigma=model_sigma)
    elif chosen == "cs2-identified":
        known = _field_model(coil.area_m2, lab, field_model)
        currents = (0.0, known.terms.current_max_A)
        if written is not None:
            write_field_model(known, written)
    zero = max(reference_offset_sigma_T, 0.0 if known is None else known.rms_T)
    offset = OFFSET_SIGMA_V.get(chosen, 0.0) if offset_sigma_V is None else offset_sigma_V
    systematics = Systematics(coil_area_sigma_m2 / coil.area_m2, reference_gain_sigma, zero, offset)
    options = IntegrationOptions(
        chosen,
        coil,
        initial_field_T,
        zero_reading_s,
        settling_s,
        still_A,
        current_to_field_A_per_T,
        known,
        systematics,
    )
    quantity = "flux_linkage_Wb" if coil_area_m2 is None else "field_T"
    made = _stream(source, columns, options, quantity, currents, smooth=smooth, output=output, progress=progress)
    end = made.last
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


@dataclass(frozen=True, eq=False)
class _Streamed:
    """What is left when a record has streamed past: its last block, and the rows where they were not written."""

    last: FieldBlock
    samples: int
    sample_time: float
    findings: tuple[Finding, ...]
    rows: pd.DataFrame | None


def _stream(
    source: CoilRecord | pd.DataFrame,
    columns: tuple[str, ...],
    options: IntegrationOptions,
    quantity: str,
    currents: tuple[float, float] | None,
    *,
    smooth: bool,
    output: Path | None,
    progress: Callable[[int, int], None] | None,
) -> _Streamed:
    blocks = map(_plausible, [_block(source)] if isinstance(source, pd.DataFrame) else source.blocks())
    total = len(source) if isinstance(source, pd.DataFrame) else source.samples
    first = next(blocks)
    integrator = make_integrator(options, first)
    record = itertools.chain([first], blocks)
    pairs = smooth_blocks(integrator, record) if smooth else integrate_blocks(integrator, record)
    watch = _watch(options, columns, quantity, integrator.sample_time, currents)
    seen, samples, corrected = watch.start(), 0, False
    value, unit = quantity.rsplit("_", 1)
    sigma_name = f"{value}_sigma_{unit}"
    names = ["time_s", *columns, quantity, sigma_name, "offset_V"]
    kept: list[pd.DataFrame] = []
    with nullcontext() if output is None else RecordWriter(output, names, integrator.sample_time) as writer:
        for block, out in pairs:
            read = {"coil_voltage_V": block.voltage, "hall_T": block.hall, "current_A": block.current}
            table = {"time_s": block.time} | {name: there for name in columns if (there := read[name]) is not None}
            table |= {quantity: out.field, sigma_name: out.sigma(options.systematics), "offset_V": out.offset}
            if writer is None:
                kept.append(pd.DataFrame(table))
            else:
                writer.write(table)
            seen = watch.advance(seen, block, out)
            samples += len(block)
            corrected |= bool(np.any(out.offset != 0.0))
            if progress is not None:
                progress(samples, total or samples)
    findings = watch.findings(seen)
    if options.method == "ffa2" and not corrected:
        findings += (_no_plateau(options.still_A),)
    rows = pd.concat(kept, ignore_index=True) if kept else None
    return _Streamed(out, samples, integrator.sample_time, findings, rows)


def _watch(
    options: IntegrationOptions,
    columns: tuple[str, ...],
    quantity: str,
    sample_time: float,
    currents: tuple[float, float] | None,
) -> RecordWatch:
    """Compare the coil with the reference that the method uses, or with one that the record has besides."""
    of_hall = options.of_hall or (options.method in FEED_FORWARD and "hall_T" in columns)
    reference: Reference | None = "hall_T" if of_hall else "current_A" if "current_A" in columns else None
    scale = None
    if of_hall and quantity == "field_T":
        scale = 1.0
    elif options.method == "cs2" and options.current_to_field is not None:
        scale = 1.0 / options.current_to_field
    return RecordWatch(options.coil.area_m2, sample_time, reference, scale, currents)


def _no_plateau(still_A: float) -> Finding:
    text = (
        f"ffa2 found no settled plateau, on which the current moves by less than {still_A:g} A in a second: nothing "
        "was taken off, and this is the plain integral."
    )
    return Finding("plateau", "warning", text, "Give --still-A, a shorter --settling-s, or another method.")


def _field_model(area_m2: float, lab: str | Path | None, given: str | Path | FieldModel | None) -> FieldModel:
    if lab is not None:
        return identified_field(lab, area_m2)
    if isinstance(given, FieldModel):
        return given
    if given is not None:
        return read_field_model(Path(given))
    raise TableError(
        "cs2-identified needs what field belongs to a current: give --lab RECORD (with hall_T and current_A, of a "
        "magnet that was cycled before), --field-model FILE, or --model MODEL.json with --distance-mm."
    )


def _require_free(read: list[Any], output: Path | None, field_model: Path | None) -> None:
    """Refuse results that would replace what is read, or a file of another kind."""
    inputs = [Path(path) for path in read if isinstance(path, str | Path)]
    raw = [path for path in inputs if path.suffix in RAW_SUFFIXES]
    sidecars = [path.with_suffix(suffix) for path in raw for suffix in (".toml", ".json")]
    sidecar = output.with_suffix(".json") if output is not None and output.suffix in RAW_SUFFIXES else None
    require_outputs([*inputs, *sidecars], (output, None), (sidecar, RAW_SIDECAR), (field_model, FIELD_MODEL))


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
