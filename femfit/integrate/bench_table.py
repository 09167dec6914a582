"""From a record of a coil's voltage to a bench table: the flux linkage on each plateau, and what looks wrong."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from json import dumps
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.files import BENCH, NOTES, replacing, require_outputs
from femfit.core.numerics import FloatArray
from femfit.core.results import Finding, Printed
from femfit.effects.conditions import Conditions
from femfit.integrate.plateaus import PlateauFlux, PlateauOptions, plateau_flux
from femfit.integrate.record_watch import RecordWatch, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from femfit.tables.coil_record import CoilBlock
from femfit.tables.columns import BENCH_COLUMNS
from femfit.tables.reading import Wants, Words, read_columns, read_raw_table

NEEDED = ("time_s", "coil_voltage_V", "current_A", "distance_m")
RECORD = Wants(
    "bench record",
    ("time_s", "coil_voltage_V", *(name for name in BENCH_COLUMNS if name != "flux_linkage_Wb")),
    needs=NEEDED,
)


@dataclass(frozen=True, eq=False, repr=False)
class BenchFlux(Printed):
    """A bench table, a row a plateau, whose flux linkage was integrated from a coil's voltage.

    ``noise_Wb`` is the standard uncertainty of a row's flux linkage from the voltage's noise, rms over the rows;
    ``notes`` say what was done, and what the noise leaves out.
    """

    rows: pd.DataFrame = field(repr=False)
    noise_Wb: float
    notes: str
    findings: tuple[Finding, ...]
    output: Path | None

    def __str__(self) -> str:
        files = () if self.output is None else (self.output, self.output.with_suffix(".toml"))
        return sentence("integral", "bench", self, ", ".join(map(str, files)))

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready, without the rows."""
        return {
            "rows": len(self.rows),
            "noise_Wb": self.noise_Wb,
            "notes": self.notes,
            "findings": [remark.as_dict() for remark in self.findings],
            "output": None if self.output is None else str(self.output),
            "sidecar": None if self.output is None else str(self.output.with_suffix(".toml")),
        }


def make_bench_table(
    record: str | Path,
    *,
    output: str | Path | None = None,
    resistance_ohm: float | None = None,
    turns_ratio: float = 1.0,
    settling_s: float = 0.0,
    still_A: float = 1e-3,
    still_m: float = 1e-6,
    model: str | Path | ActuatorModel | None = None,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    table: str | None = None,
) -> BenchFlux:
    """Integrate a coil's voltage run by run, and average it and the other columns on the plateaus.

    The offset voltage is that of each settled plateau, linear between.

    Parameters
    ----------
    record : path
        ``time_s, coil_voltage_V, current_A, distance_m``, and any other column of a bench table.
    output : path
        The bench table, .csv; its sidecar .toml with noise and notes is written beside it.
    resistance_ohm : float
        Of the excitation winding, where the voltage is its own: R i is taken off.
    settling_s, still_A, still_m : float
        Seconds left out after each change; movements from sample to sample that still belong to a plateau.
    model : path or model
        Gives the flux linkage on each run's first plateau; 0 without one.
    columns, units, table : optional
        What the record's columns are and in which unit, and which table of its file it is, as in
        :func:`femfit.read_measurement`.
    """
    record = Path(record)
    output = None if output is None else Path(output)
    if output is not None:
        if output.suffix != ".csv":
            raise TableError(f"The bench table is written as .csv; instead received {output}.")
        path = model if isinstance(model, str | Path) else None
        inputs = [record, None if path is None else Path(path)]
        require_outputs(inputs, (output, BENCH), (output.with_suffix(".toml"), NOTES))
    first = None if model is None else model_of(model)
    source = "" if model is None else model.name if isinstance(model, ActuatorModel) else Path(model).name
    words = Words(columns or {}, units or {}, table)
    rows = read_columns(read_raw_table(record, RECORD.what, (RECORD,), words), RECORD, words).rows
    rows = rows.dropna(subset=list(NEEDED))  # a row without one of these is a gap, and said to be one
    if rows.empty:
        raise TableError(f"{record} has no row with a time, a voltage, a current and a distance.")
    rows = rows if "run" in rows else rows.assign(run=1.0)
    rows = rows.assign(induced_V=(rows["coil_voltage_V"] - (resistance_ohm or 0.0) * rows["current_A"]) * turns_ratio)
    options = PlateauOptions(settling_s, still_A, still_m)
    tables, variances, remarks = zip(
        *(_of_run(run, options, first) for _, run in rows.groupby("run", sort=False)), strict=True
    )
    made, sigma = pd.concat(tables, ignore_index=True), float(np.sqrt(np.mean(np.concatenate(variances))))
    notes = sentence("integral", "notes", record.name, resistance_ohm, turns_ratio, source)
    result = BenchFlux(made, sigma, notes, tuple(chain(*remarks)), output)
    if output is not None:
        noted = " ".join([notes, *map(str, result.findings)])
        with replacing(output) as table_file, replacing(output.with_suffix(".toml")) as sidecar:  # both or neither
            made.to_csv(table_file, index=False)
            sidecar.write_text(f"flux_linkage_Wb = {sigma:.6g}\nnotes = {dumps(noted)}\n", encoding="utf-8")
    return result


def _of_run(
    run: pd.DataFrame, options: PlateauOptions, first: ActuatorModel | None
) -> tuple[pd.DataFrame, FloatArray, list[Finding]]:
    """A run's rows of the bench table, the variances of their flux linkages, and what is wrong with the run."""
    time, voltage, induced, current, distance = (
        run[name].to_numpy() for name in (*NEEDED[:2], "induced_V", *NEEDED[2:])
    )
    flux = plateau_flux(time, induced, current, distance, options)
    columns = run.drop(columns=["induced_V", "coil_voltage_V", "branch", "order"], errors="ignore")
    means = pd.DataFrame([columns.iloc[a:b].mean() for a, b in zip(flux.first, flux.last, strict=True)])
    means = means.assign(order=means["time_s"] - time[0], branch=flux.branch)
    begin = 0.0
    if first is not None:
        place = means["distance_m"].to_numpy()[:1], means["current_A"].to_numpy()[:1]
        begin = float(predict_readings(first, *place, Conditions(nominal=nominal_of(first)))["flux_linkage_Wb"][0])
    number = f"Run {run['run'].iloc[0]:g}: "
    remarks = [replace(told, text=number + told.text) for told in watch_run(time, voltage, induced, current, flux)]
    return means.drop(columns="time_s").assign(flux_linkage_Wb=begin + flux.flux), flux.sigma**2, remarks


def watch_run(
    time: FloatArray, voltage: FloatArray, induced: FloatArray, current: FloatArray, plateau_flux: PlateauFlux
) -> tuple[Finding, ...]:
    """Gaps, clock jumps, samples clipped between plateaus, and a coil wired the wrong way round, of one run."""
    between = voltage.copy()
    for first, last in zip(plateau_flux.first, plateau_flux.last, strict=True):
        between[first:last] = 0.0
    step = float(np.median(np.diff(time)))
    watch, wired = RecordWatch(1.0, step), RecordWatch(1.0, step, "current_A")
    watch.see(CoilBlock(time, between))
    wired.see(CoilBlock(time, induced, current=current))
    return (*watch.findings(), *(remark for remark in wired.findings() if remark.code == "sign"))
