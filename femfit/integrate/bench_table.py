"""From a record of a coil's voltage to a bench table: the flux linkage on each plateau, and what looks wrong.

The offset is the mean voltage of a settled plateau: P. Arpaia et al., Sensors 22 (2022) 182, section 3; F. Fiorillo,
Characterization and Measurement of Magnetic Materials (Elsevier, 2004), section 5.1 (integrator drift).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise
from json import dumps
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid

from femfit.core.errors import TableError
from femfit.core.files import BENCH, NOTES, replacing, require_outputs
from femfit.core.numerics import FloatArray, IntArray
from femfit.core.results import Finding, Result
from femfit.effects.conditions import Conditions
from femfit.integrate.record_watch import RecordWatch, sentence
from femfit.integrate.uncertainty import white_sigma
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from femfit.tables.coil_record import CoilBlock
from femfit.tables.columns import BENCH_COLUMNS
from femfit.tables.reading import Wants, Words, read_columns, read_raw_table, words_of

NEEDED = ("time_s", "coil_voltage_V", "current_A", "distance_m")
RECORD = Wants(
    "bench record",
    ("time_s", "coil_voltage_V", *(name for name in BENCH_COLUMNS if name != "flux_linkage_Wb")),
    needs=NEEDED,
)

_LEAST = 3
"""Samples of a settled plateau."""

_ROUNDING = 1e-9
"""Resolution of a clock, s."""


@dataclass(frozen=True)
class PlateauOptions:
    """How a run is cut and its offset voltage found, as :func:`make_bench_table` says.

    An error of R i on a plateau is taken off with the offset. Neither neighbouring samples of a
    plateau nor its first and last quarter may differ by more than ``still_A`` and ``still_m``.
    """

    settling: float = 0.0
    still_A: float = 1e-3
    still_m: float = 1e-6


@dataclass(frozen=True, eq=False)
class PlateauFlux:
    """Flux linkage on the p settled plateaus of a run, arrays of shape (p,)."""

    # Samples of each plateau, the last exclusive
    first: IntArray
    last: IntArray
    # Mean flux linkage minus that of the first plateau, Wb, and its standard uncertainty (type A): from the samples'
    # white noise and the offset's wander between plateaus
    flux: FloatArray
    sigma: FloatArray
    branch: FloatArray  # Sign of the last change of current: +1, -1, or 0 before any


@dataclass(frozen=True, eq=False, repr=False)
class BenchFlux(Result):
    """A bench table, a row a plateau, whose flux linkage was integrated from a coil's voltage.

    ``noise_Wb`` is the standard uncertainty of a row's flux linkage from the voltage's noise, rms over the rows;
    ``notes`` say what was done, and what the noise leaves out.
    """

    data = "rows=rows.index.size", "noise_Wb", "notes", "findings", "output", "sidecar"

    rows: pd.DataFrame = field(repr=False)
    noise_Wb: float
    notes: str
    findings: tuple[Finding, ...]
    output: Path | None

    def __str__(self) -> str:
        files = () if self.output is None else (self.output, self.sidecar)
        return sentence("integral", "bench", self, ", ".join(map(str, files)))

    @property
    def sidecar(self) -> Path | None:
        """The file beside the output, with noise and notes."""
        return self.output and self.output.with_suffix(".toml")


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
    resistance_ohm : float >= 0 or None
        Resistance of the excitation winding, whose R i is taken off where the voltage is that winding's own; not for a
        separate sensing coil.
    turns_ratio : float > 0
        Turns of the excitation winding over those of the sensing coil.
    settling_s : float >= 0
        Time left out after each change, until the eddy currents have decayed.
    still_A : float >= 0
        Largest change of the current from sample to sample on a plateau.
    still_m : float >= 0
        Largest change of the distance from sample to sample on a plateau.
    model : str, Path, ActuatorModel or None
        Model that gives the flux linkage on each run's first plateau; 0 without one.
    columns, units, table : optional
        What the record's columns are and in which unit, and which table of its file it is, as in
        :func:`femfit.read_measurement`.
    """
    record = Path(record)
    output = None if output is None else Path(output)
    if output is not None:
        if output.suffix != ".csv":
            raise TableError(f"The bench table is written as .csv; instead received {output}.")
        inputs = [record, Path(model) if isinstance(model, str | Path) else None]
        require_outputs(inputs, (output, BENCH), (output.with_suffix(".toml"), NOTES))
    first = None if model is None else model_of(model)
    source = "" if model is None else model.name if isinstance(model, ActuatorModel) else Path(model).name
    words = words_of(record, Words(columns or {}, units or {}, table))
    rows, *_ = read_columns(read_raw_table(record, RECORD.what, (RECORD,), words), RECORD, words)
    rows = rows.dropna(subset=list(NEEDED))  # a row without one of these is a gap, and said to be one
    if rows.empty:
        raise TableError(f"{record} has no row with a time, a voltage, a current and a distance.")
    rows = rows if "run" in rows else rows.assign(run=1.0)
    if rows["run"].isna().any():
        raise TableError(f"Each row of {record} must say its run, or none; {int(rows['run'].isna().sum())} do not.")
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
    remarks = [replace(r, text=number + r.text) for r in watch_run(time, voltage, induced, current, flux)]
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


def plateau_flux(
    time: FloatArray, voltage: FloatArray, current: FloatArray, distance: FloatArray, options: PlateauOptions
) -> PlateauFlux:
    """Integrate a run's induced voltage dlambda/dt plus offset, V, and average it on the plateaus.

    The voltage is u - R i of an excitation winding, u of a sensing coil; current in A and
    distance in m tell the plateaus.
    """
    if len(time) < _LEAST or np.any(np.diff(time) <= 0.0):
        raise TableError("A bench record's time_s must rise in each run; give each run its number in a column run.")
    first, last = _plateaus(time, current, distance, options)
    if len(first) < 2:
        raise TableError(
            f"A run needs at least 2 plateaus of {_LEAST} samples; {len(first)} found, with current still to "
            f"{options.still_A:g} A, distance to {options.still_m:g} m and {options.settling:g} s of settling. Raise "
            "the limits above the noise of these columns, or shorten the settling."
        )
    spans = list(zip(first, last, strict=True))
    means, level = (np.array([values[a:b].mean() for a, b in spans]) for values in (voltage, current))
    rest = voltage - np.interp(time, time[np.stack([first, last - 1], axis=1)].ravel(), np.repeat(means, 2))
    flux = cumulative_trapezoid(rest, time, initial=0)
    mean = np.array([flux[a:b].mean() for a, b in spans])
    sigma = np.sqrt(_variance(time, voltage, first, last))
    change = np.diff(level, prepend=level[0])
    turns = pd.Series(np.sign(change)).where(np.abs(change) > options.still_A).ffill().fillna(0.0)
    return PlateauFlux(first, last, mean - mean[0], sigma, np.asarray(turns, np.float64))


def _variance(time: FloatArray, voltage: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    """Variance of a plateau's mean integral minus the first's, Wb^2, by white noise and by the offset's wander; (p,).

    On a plateau the mean is taken off, which leaves a bridge whose mean has held / 12; between plateaus the walk and
    the two means' errors count, each mean in the gap before it and in the gap after it.

    How far the offset leaves the straight line between plateaus is seen where nothing changes: the middle of each
    plateau, as long as the time between two, against the means of the rest before and after it. What white noise does
    to that is taken off. Cautious: two gaps share a plateau's mean, and a part of their errors cancels.
    """
    noise, step, count = white_sigma(voltage), float(np.median(np.diff(time))), last - first
    held, gap = step * count, time[first[1:]] - time[last[:-1] - 1]
    before, after = np.concatenate([[0.0], gap]), np.concatenate([gap, [0.0]])
    inner = np.concatenate([[0.0], np.cumsum(np.square(before + after) / 4.0 / count)])[:-1]
    through = inner + np.square(before) / 4.0 / count
    white = step * (np.cumsum(before) + (held[0] + held) / 12.0) + through
    white[0] = 0.0  # against itself
    middle = max(1, round(float(np.median(gap)) / step))
    surplus = []
    for a, side in zip(first, (count - middle) // 2, strict=True):
        if side < 1:
            continue
        early, between, late = np.split(voltage[a : a + 2 * side + middle], [side, side + middle])
        strayed = step * (between.sum() - 0.5 * middle * (early.mean() + late.mean()))
        surplus.append(strayed**2 - (step * noise) ** 2 * (middle + 0.5 * middle**2 / side))
    wander = max(0.0, float(np.mean(surplus))) if surplus else 0.0
    return noise**2 * white + wander * np.cumsum(np.square(before / (step * middle)))


def _plateaus(
    time: FloatArray, current: FloatArray, distance: FloatArray, options: PlateauOptions
) -> tuple[IntArray, IntArray]:
    """Settled stretches in which neither current nor distance moves."""
    moved = (np.abs(np.diff(current)) > options.still_A) | (np.abs(np.diff(distance)) > options.still_m)
    cuts = np.concatenate([[0], np.flatnonzero(moved) + 1, [len(time)]])
    channels = ("current", current, options.still_A, "A"), ("distance", distance, options.still_m, "m")
    spans = []
    for a, b in pairwise(cuts.tolist()):
        # A sample beside a change may hold a part of it. The first plateau follows no change, the last precedes none.
        begin = a if a == 0 else max(a + 1, int(np.searchsorted(time, time[a] + options.settling - _ROUNDING)))
        end = b if b == len(time) else b - 1
        if end - begin < _LEAST:
            continue
        spans.append((begin, end))
        quarter = max(1, (end - begin) // 4)
        for name, values, still, unit in channels:
            crept = abs(float(values[end - quarter : end].mean() - values[begin : begin + quarter].mean()))
            if crept > still:
                raise TableError(
                    f"The {name} changes slowly from {time[begin]:g} to {time[end - 1]:g} s, by {crept:.3g} {unit} in "
                    f"all, although no two neighbouring samples differ by more than {still:g} {unit}. If this is a "
                    "ramp, give a limit below its step from sample to sample, or leave out samples; if it is a "
                    f"plateau, give a limit above the change. The limit is --still-{'A' if unit == 'A' else 'um'}."
                )
    pairs = np.array(spans, dtype=np.int64).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
