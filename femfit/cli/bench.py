"""``femfit bench``: a bench table with flux linkage from a record of a coil's voltage."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

if TYPE_CHECKING:
    import pandas as pd

    from femfit.integrate.plateaus import PlateauOptions
    from femfit.integrate.record_watch import Finding
    from femfit.model.actuator_model import ActuatorModel

NotNegative = Number(gte=0.0)


def bench(
    record: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    resistance_ohm: Annotated[float | None, Parameter(validator=NotNegative)] = None,
    turns_ratio: Annotated[float, Parameter(validator=Number(gt=0.0))] = 1.0,
    method: Literal["trapezoid", "ffa1", "plateaus"] = "plateaus",
    settling_s: Annotated[float, Parameter(validator=NotNegative)] = 0.0,
    still_A: Annotated[float, Parameter(name="--still-A", validator=NotNegative)] = 1e-3,
    still_um: Annotated[float, Parameter(validator=NotNegative)] = 1.0,
    model: Path | None = None,
    initial_flux_Wb: Annotated[float | None, Parameter(name="--initial-flux-Wb")] = None,
    json: Path | None = None,
) -> None:
    """Make a bench table for compare and diagnose from a record of a coil's voltage: one row a plateau.

    Parameters
    ----------
    record : Path
        CSV or Parquet with time_s, coil_voltage_V, current_A and distance_m, and any other column of a bench table
        (run, mount, force_N, ...), which is averaged on the plateaus. Each run is integrated on its own.
    output : Path
        Bench table, .csv; its sidecar .toml, with noise and notes, is written beside it.
    resistance_ohm : float
        Of the excitation winding, where the voltage is its own: R i is taken off. Not for a separate sensing coil.
    turns_ratio : float
        Turns of the excitation winding over those of the sensing coil.
    method : str
        plateaus (offset voltage from each settled plateau, linear between), ffa1 (from each run's first plateau), or
        trapezoid (none: drifts).
    settling_s : float
        Seconds left out after each change, until the eddy currents have decayed.
    still_A : float
        A current that moves by less from sample to sample is on a plateau.
    still_um : float
        The same for the distance.
    model : Path
        Model file that gives the flux linkage on each run's first plateau.
    initial_flux_Wb : float
        That flux linkage, where it is known; default 0.
    json : Path
        File for the result as JSON.
    """
    from json import dumps

    from femfit.cli.output import write_json
    from femfit.core.atomic import replacing, write_text
    from femfit.core.errors import TableError
    from femfit.core.outputs import NOTES, RESULT, TABLE, require_outputs
    from femfit.integrate.bench_watch import resistance_finding
    from femfit.integrate.plateaus import PlateauOptions
    from femfit.model.json_file import read_model

    if output.suffix != ".csv":
        raise TableError(f"The bench table is written as .csv; instead received {output}.")
    require_outputs([record, model], (output, TABLE), (output.with_suffix(".toml"), NOTES), (json, RESULT))
    if model is not None and initial_flux_Wb is not None:
        raise TableError("Give the first plateau's flux linkage by --model or by --initial-flux-Wb, not by both.")
    options = PlateauOptions(method, settling_s, still_A, 1e-6 * still_um)
    rows = _read(record)
    induced = (rows["coil_voltage_V"] - (resistance_ohm or 0.0) * rows["current_A"]) * turns_ratio
    start = read_model(model) if model is not None else initial_flux_Wb or 0.0
    table, sigma, findings = _table(rows.assign(induced_V=induced), options, start)
    level = resistance_finding(table.pop("coil_voltage_V").to_numpy(), table["current_A"].to_numpy(), resistance_ohm)
    if level is not None:
        findings.append(level)
    begins = f"taken from {model.name}" if model is not None else f"taken as {initial_flux_Wb or 0.0:g} Wb"
    taken = "no R i taken off" if resistance_ohm is None else f"R i taken off with {resistance_ohm:g} ohm"
    notes = (
        f"Flux linkage integrated from the coil voltage of {record.name} ({method}, {taken}, turns ratio "
        f"{turns_ratio:g}); on each run's first plateau it was {begins}, not measured. The noise is the rms standard "
        "uncertainty of the integral from the voltage's noise; it accumulates within a run. Not in it: errors of "
        "resistance, turns ratio, voltmeter gain and first value"
        + ("; the offset voltage, which was not taken off." if method == "trapezoid" else ".")
    )
    noted = " ".join([notes, *(finding.sentence for finding in findings)])
    with replacing(output) as partial:
        table.to_csv(partial, index=False)
    side = output.with_suffix(".toml")
    write_text(side, f"flux_linkage_Wb = {sigma:.6g}\nnotes = {dumps(noted)}\n")
    result = {
        "rows": len(table),
        "noise_Wb": sigma,
        "notes": notes,
        "findings": [{"kind": finding.kind, "sentence": finding.sentence} for finding in findings],
        "output": str(output),
        "sidecar": str(side),
    }
    print(f"{len(table)} plateaus, flux linkage within {sigma:.3g} Wb (noise, rms)\n{notes}")
    print("".join(f"{finding.kind}: {finding.sentence}\n" for finding in findings), end="")
    print(f"written: {output}, {side}")
    write_json(json, result)


def _read(record: Path) -> "pd.DataFrame":
    """Columns of a bench record in SI."""
    from femfit.core.errors import TableError
    from femfit.core.finding import listing
    from femfit.tables.measurement_columns import BENCH_COLUMNS, column_values, recognise
    from femfit.tables.measurement_file import read_raw_table

    names = ("time_s", "coil_voltage_V", *(name for name in BENCH_COLUMNS if name != "flux_linkage_Wb"))
    raw = read_raw_table(record, "bench record")
    used, _ = recognise(raw.headers, str(record), names)
    rows, _ = column_values(raw, used)
    missing = [name for name in ("time_s", "coil_voltage_V", "current_A", "distance_m") if name not in rows]
    if missing:
        raise TableError(f"A bench record needs {', '.join(missing)}; {record} has {listing(raw.headers)}.")
    rows = rows if "run" in rows else rows.assign(run=1.0)
    # A row without one of these is a gap, and said to be one.
    rows = rows.dropna(subset=["time_s", "coil_voltage_V", "current_A", "distance_m"])
    if rows.empty:
        raise TableError(f"{record} has no row with a time, a voltage, a current and a distance.")
    return rows


def _table(
    rows: "pd.DataFrame", options: "PlateauOptions", start: "ActuatorModel | float"
) -> "tuple[pd.DataFrame, float, list[Finding]]":
    """The bench table of all runs with the voltage's means, the rms of the flux linkage's noise, and what is wrong."""
    from dataclasses import replace

    import numpy as np
    import pandas as pd

    from femfit.effects.conditions import Conditions
    from femfit.integrate.bench_watch import watch_run
    from femfit.integrate.plateaus import plateau_flux
    from femfit.model.readings import predict_readings
    from femfit.model.with_effects import nominal_of

    pieces, variances, findings = [], [], []
    for run in pd.unique(rows["run"]):
        one = rows[rows["run"] == run].reset_index(drop=True)
        time, voltage, induced, current, distance = (
            one[name].to_numpy() for name in ("time_s", "coil_voltage_V", "induced_V", "current_A", "distance_m")
        )
        found = plateau_flux(time, induced, current, distance, options)
        seen = watch_run(time, voltage, induced, current, found)
        findings += [replace(finding, sentence=f"Run {run:g}: {finding.sentence}") for finding in seen]
        spans = list(zip(found.first, found.last, strict=True))
        kept = one.drop(columns=["induced_V", "branch", "order"], errors="ignore")
        means = pd.DataFrame([kept.iloc[a:b].mean() for a, b in spans])
        means = means.assign(order=means["time_s"] - time[0], branch=found.branch)
        begin = start
        if not isinstance(begin, int | float):
            at = Conditions(nominal=nominal_of(begin))
            first = means.iloc[:1]
            values = predict_readings(begin, first["distance_m"].to_numpy(), first["current_A"].to_numpy(), at)
            begin = float(values["flux_linkage_Wb"][0])
        pieces.append(means.drop(columns="time_s").assign(flux_linkage_Wb=begin + found.flux))
        variances.append(found.sigma**2)
    return pd.concat(pieces, ignore_index=True), float(np.sqrt(np.mean(np.concatenate(variances)))), findings
