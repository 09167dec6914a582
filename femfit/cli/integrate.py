"""``femfit integrate``: drift-free flux or field from a coil's voltage."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

if TYPE_CHECKING:
    from femfit.integrate.methods import IntegrationOptions
    from femfit.integrate.record_watch import Finding
    from femfit.tables.coil_record import CoilRecord

MethodOption = Literal["trapezoid", "ffa1", "ffa2", "cs1", "cs2", "cs1-offset", "cs2-identified"]
Positive = Number(gt=0.0)
NotNegative = Number(gte=0.0)


def integrate(
    record: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    coil_area: float | None = None,
    method: MethodOption | None = None,
    treatment: Literal["gum", "paper"] = "gum",
    initial_field_T: Annotated[float | None, Parameter(name="--initial-field-T")] = None,
    zero_reading_s: Annotated[float, Parameter(validator=Positive)] = 60.0,
    settling_s: Annotated[float | None, Parameter(validator=NotNegative)] = None,
    still_A: Annotated[float, Parameter(name="--still-A", validator=Positive)] = 0.1,
    current_to_field: Annotated[float, Parameter(validator=Positive)] = 316.0,
    lab: Path | None = None,
    field_model: Path | None = None,
    model: Path | None = None,
    distance_mm: Annotated[float | None, Parameter(validator=Positive)] = None,
    model_sigma: Annotated[float | None, Parameter(validator=Positive)] = None,
    smooth: Annotated[bool, Parameter(negative="")] = False,
    coil_area_sigma: Annotated[float, Parameter(validator=NotNegative)] = 0.0,
    reference_gain_sigma: Annotated[float, Parameter(validator=NotNegative)] = 0.0,
    reference_offset_sigma_T: Annotated[
        float, Parameter(name="--reference-offset-sigma-T", validator=NotNegative)
    ] = 0.0,
    offset_sigma_uV: Annotated[float | None, Parameter(name="--offset-sigma-uV", validator=NotNegative)] = None,
    coverage: Annotated[float, Parameter(validator=Positive)] = 2.0,
    json: Path | None = None,
) -> None:
    """Integrate a coil's voltage to its field (or, without an area, its flux linkage) and say how sure that is.

    Writes the record's rows with field_T (or flux_linkage_Wb), its standard uncertainty and the offset voltage.

    Parameters
    ----------
    record : Path
        CSV or Parquet with time_s, coil_voltage_V, and hall_T or current_A; or raw float32 (.bin, .raw, .f32) with a
        sidecar .toml or .json that has sample_rate_Hz and columns.
    output : Path
        .csv, .parquet, .bin, .raw or .f32.
    coil_area : float
        Total area of the coil in m2; filters need it.
    method : str
        trapezoid; ffa1 (initial zero reading); ffa2 (mean on each plateau); cs1, cs2 (Kalman filter with Hall probe,
        with the current); cs1-offset (with the offset voltage as a second state); cs2-identified (with a field model).
        Default: cs1-offset where the record has a Hall probe and an area is given, else ffa2.
    treatment : str
        gum keeps noise and systematics apart; paper is the published filter's literal weights.
    initial_field_T : float
        Field at the record's begin (flux linkage in Wb without an area); default: 0, or the reference's first reading.
    zero_reading_s : float
        Zero reading of ffa1.
    settling_s : float
        Of ffa2 after each ramp; default 20, 25 and 30 s at 3.2, 32 and 100 A/s.
    still_A : float
        Of ffa2: a current that moves by less in a second is on a plateau.
    current_to_field : float
        Of cs2, in A/T.
    lab : Path
        Of cs2-identified: a record with Hall probe and current of a cycled magnet, to identify its field from.
    field_model : Path
        Of cs2-identified: JSON file of the identified field; written with --lab, read without.
    model : Path
        Of cs2-identified: femfit model file, whose swept field at the Hall element (without an area, flux linkage)
        takes the place of an identified one; the coil must sit where the Hall element does.
    distance_mm : float
        Of the moving part, with --model.
    model_sigma : float
        Standard uncertainty of the model's field in T (flux linkage in Wb), with --model: remanence and eddy currents,
        which a sweep does not know, included; default 1 % of its largest.
    smooth : bool
        Let the whole record speak for every sample, offline: a Kalman smoother after the filter. Needs all of the
        record in memory, 0.3 GB for a million samples.
    coil_area_sigma : float
        Standard uncertainty of the area in m2.
    reference_gain_sigma : float
        Relative standard uncertainty of the Hall probe's (or the current-to-field ratio's) gain.
    reference_offset_sigma_T : float
        Standard uncertainty of the reference's zero.
    offset_sigma_uV : float
        Of the offset voltage that a method leaves; default 20 (trapezoid, cs1, cs2), 5 (ffa1, ffa2) and 0 (cs1-offset,
        cs2-identified, which estimate it).
    coverage : float
        Coverage factor of the printed uncertainty.
    json : Path
        File for the result as JSON.
    """
    from femfit.cli.field_models import identified_field, swept_field
    from femfit.cli.output import write_json
    from femfit.core.errors import TableError
    from femfit.integrate.methods import IntegrationOptions
    from femfit.integrate.uncertainty import SensingCoil, Systematics
    from femfit.tables.coil_record import open_coil_record

    source = open_coil_record(record)
    chosen = method or ("cs1-offset" if coil_area is not None and "hall_T" in source.columns else "ffa2")
    if coil_area is None and chosen not in {"trapezoid", "ffa1", "ffa2"} and model is None:
        raise TableError(f"{chosen} compares a coil with a field and needs the coil's area: give --coil-area in m2.")
    identified = None if lab is None else field_model
    _require_free([record, lab, model, field_model if lab is None else None], output, identified, json)
    coil = SensingCoil(1.0 if coil_area is None else coil_area, coil_area_sigma)
    field, currents = None, None
    if model is not None:
        if chosen != "cs2-identified" or lab is not None or field_model is not None or distance_mm is None:
            raise TableError(
                "--model goes with --method cs2-identified and --distance-mm, without --lab, --field-model."
            )
        field, currents = swept_field(model, 1e-3 * distance_mm, coil_area is None, model_sigma)
    elif chosen == "cs2-identified":
        field = identified_field(coil, lab, field_model)
        currents = (0.0, field.terms.current_max_A)
        if lab is not None and field_model is not None:
            print(f"written: {field_model}")
    left = {"trapezoid": 20.0, "cs1": 20.0, "cs2": 20.0, "ffa1": 5.0, "ffa2": 5.0}.get(chosen, 0.0)
    offset = 1e-6 * (left if offset_sigma_uV is None else offset_sigma_uV)
    zero = max(reference_offset_sigma_T, 0.0 if field is None else field.rms_T)
    options = IntegrationOptions(
        chosen,
        coil,
        treatment,
        initial_field_T,
        zero_reading_s,
        settling_s,
        still_A,
        current_to_field,
        field,
        Systematics(coil_area_sigma / coil.area_m2, reference_gain_sigma, zero, offset),
    )
    quantity = "flux_linkage_Wb" if coil_area is None else "field_T"
    result, findings = _stream(source, options, output, quantity, coverage, currents, smooth)
    print("\n".join(_lines(result, findings)))
    write_json(json, result)


def _require_free(read: Sequence[Path | None], output: Path, field_model: Path | None, json: Path | None) -> None:
    """Refuse results that would replace what is read, or a file of another kind."""
    from femfit.core.outputs import FIELD_MODEL, RAW_SIDECAR, RESULT, require_outputs
    from femfit.tables.coil_record import RAW_SUFFIXES

    raw = [path for path in read if path is not None and path.suffix in RAW_SUFFIXES]
    sidecars = [path.with_suffix(suffix) for path in raw for suffix in (".toml", ".json")]
    written = [(output.with_suffix(".json"), RAW_SIDECAR)] if output.suffix in RAW_SUFFIXES else []
    require_outputs([*read, *sidecars], (output, None), *written, (field_model, FIELD_MODEL), (json, RESULT))


def _stream(
    source: "CoilRecord",
    options: "IntegrationOptions",
    output: Path,
    quantity: str,
    coverage: float,
    currents: tuple[float, float] | None,
    smooth: bool,
) -> tuple[dict[str, Any], tuple["Finding", ...]]:
    """Integrate from file to file, block by block or, smoothed, all at once."""
    import itertools
    import time

    import numpy as np

    from femfit.cli.output import progress_bar
    from femfit.integrate.methods import integrate_blocks, make_integrator
    from femfit.integrate.record_watch import RecordWatch, no_plateau
    from femfit.integrate.smoother import smooth_blocks
    from femfit.tables.coil_record import RecordWriter

    begin = time.perf_counter()
    blocks = source.blocks()
    first = next(blocks)
    integrator = make_integrator(options, first)
    record = itertools.chain([first], blocks)
    pairs = smooth_blocks(integrator, record) if smooth else integrate_blocks(integrator, record)
    systematics = options.systematics if options.treatment == "gum" else None
    ratio = options.current_to_field if options.field_model is None else options.field_model.current_to_field
    watch = RecordWatch(options.coil.area_m2, integrator.sample_time, ratio, currents)
    seen, samples, corrected = watch.start(), 0, False
    sigma_name = quantity.rsplit("_", 1)[0] + "_sigma_" + quantity.rsplit("_", 1)[1]
    names = ["time_s", *source.columns, quantity, sigma_name, "offset_V"]
    with (
        progress_bar(f"integrate {source.path.name}") as show,
        RecordWriter(output, names, integrator.sample_time) as writer,
    ):
        for block, out in pairs:
            sigma = out.sigma(systematics)
            columns = dict(zip(names[:1], [block.time], strict=True))
            read = {"coil_voltage_V": block.voltage, "hall_T": block.hall, "current_A": block.current}
            columns |= {name: values for name in source.columns if (values := read[name]) is not None}
            writer.write(columns | {quantity: out.field, sigma_name: sigma, "offset_V": out.offset})
            seen = watch.advance(seen, block, out)
            samples += len(block)
            corrected |= bool(np.any(out.offset != 0.0))
            if show is not None:
                show(samples, source.samples or samples)
    findings = watch.findings(seen, options.of_hall)
    if options.method == "ffa2" and not corrected:
        findings += (no_plateau(options.still_A),)
    parts = {"noise": float(np.sqrt(out.variance[-1]))}
    if systematics is not None and out.responses is not None:
        parts |= {name: float(values[-1]) for name, values in out.responses.parts(systematics).items()}
    result = {
        "record": str(source.path),
        "method": options.method,
        "smoothed": smooth,
        "treatment": options.treatment,
        "quantity": quantity,
        "samples": samples,
        "sample_time_s": integrator.sample_time,
        "end": {
            "time_s": float(out.time[-1]),
            "value": float(out.field[-1]),
            "standard_uncertainty": float(sigma[-1]),
            "expanded_uncertainty": coverage * float(sigma[-1]),
            "coverage_factor": coverage,
            "parts": parts,
            "offset_V": float(out.offset[-1]),
        },
        "findings": [{"kind": finding.kind, "sentence": finding.sentence} for finding in findings],
        "output": str(output),
        "seconds": time.perf_counter() - begin,
    }
    return result, findings


def _lines(result: dict[str, Any], findings: tuple["Finding", ...]) -> list[str]:
    end, unit = result["end"], result["quantity"].rsplit("_", 1)[1]
    parts = ", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in end["parts"].items() if value > 0.0)
    none = [name.replace("_", " ") for name, value in end["parts"].items() if value == 0.0]
    rate = 1.0 / result["sample_time_s"]
    value = f"{end['value']:.9g} {unit} +- {end['expanded_uncertainty']:.3g} {unit} (k = {end['coverage_factor']:g})"
    how = result["treatment"] + (", smoothed" if result["smoothed"] else "")
    lines = [
        f"{result['method']} ({how}): {result['samples']} samples, {rate:.6g} Hz",
        f"at {end['time_s']:.6g} s: {value}, offset {1e6 * end['offset_V']:.3g} uV",
        f"standard uncertainty in {unit}: {parts}" + (f"; nothing given for {', '.join(none)}" if none else ""),
    ]
    return [*lines, *(f"{finding.kind}: {finding.sentence}" for finding in findings), f"written: {result['output']}"]
