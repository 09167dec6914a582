"""Measured files of any kind, with an optional sidecar, to checked bench tables and time series.

Beside them a small table of columns: inductances at clamped distances.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.text import quoted
from femfit.tables.checks import BENCH_CHECKS, RECORD_CHECKS, checked, copies
from femfit.tables.columns import BENCH_COLUMNS, column_option, match_column
from femfit.tables.containers import SUFFIXES
from femfit.tables.findings import finding, refused
from femfit.tables.header import OF_CIRCUITS, parse_header, parts_of
from femfit.tables.impedance import IMPEDANCES, in_series
from femfit.tables.measurement import (
    CHANNELS,
    IMPEDANCE_SHARE,
    OF_RUNS,
    SERIES_CHANNELS,
    SERIES_COLUMNS,
    SETTINGS,
    BenchTable,
    InductanceTable,
    Measurement,
    TimeSeries,
    branch_from_order,
    check_clock,
    in_measuring_order,
)
from femfit.tables.raw_table import RawTable, clock_seconds
from femfit.tables.reading import Wants, Words, declared_noise, read_columns, read_raw_table, words_of
from femfit.tables.units import unit_factor

BENCH = Wants(
    "bench table",
    BENCH_COLUMNS,
    needs=("distance_m",),
    one_of=CHANNELS,
    circuits=OF_CIRCUITS,
    hints={"distance_m": "Where it was the same throughout, say --setting distance_mm=2.0."},
)
SERIES = Wants("time series", SERIES_COLUMNS, needs=("time_s",), one_of=SERIES_CHANNELS, circuits=SERIES_CHANNELS)

_PROTOCOL_STEP_S = 1.0
"""Chosen: a hand writes down no two readings in a second, and no motion of an actuator is sampled so slowly."""


def read_measurement(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str | float] | None = None,
    table: str | None = None,
    noise: Mapping[str, float] | None = None,
    settings: Mapping[str, float] | None = None,
) -> Measurement:
    """Read a measured file: a time series where it has a column of times, else a bench table.

    Parameters
    ----------
    path : str or Path
        ``.csv`` (commas, semicolons, tabs or blanks; decimal point or comma; title lines are passed over),
        ``.parquet``, ``.xlsx``, ``.mat``, HDF5, TDMS or ``.wav``; ``NAME.toml`` or ``NAME.csv.toml``
        beside it may declare the noise.
    columns : mapping of str to str, optional
        Column that a header is, where its name does not say it: ``{"Kraft": "force_N"}``.
    units : mapping of str to str, optional
        Unit of a header, or a number that multiplies it to SI: ``{"Kraft": "gf"}``.
    table : str, optional
        Sheet, group or struct of a file that holds several tables (XLSX, MAT, HDF5, TDMS).
    noise : mapping of str to float, optional
        Standard deviation of one reading by channel, which counts before the sidecar's: ``{"force_N": 2e-4}``; of
        impedances also a share of their magnitude, ``{"impedance_percent": 0.1}``.
    settings : mapping of str to float, optional
        Setting without a column that was the same throughout, in any unit: ``{"distance_mm": 2}``.

    Raises
    ------
    TableError
        If it is no path, there is no such file, or it is not such a table.

    Examples
    --------
    >>> import femfit as ff
    >>> bench = ff.read_measurement("bench.csv")
    >>> bench.channels
    ('force_N', 'flux_linkage_Wb', 'hall_V', 'voltage_V')
    """
    if not isinstance(path, str | Path):
        raise refused("no-measurement", received=type(path).__name__)
    words = words_of(Path(path), Words(columns or {}, units or {}, table, noise or {}, settings or {}))
    raw = read_raw_table(Path(path), kinds=(BENCH, SERIES, IMPEDANCES), words=words)
    if IMPEDANCES.fits(raw, words):
        return _bench_table(raw, words)
    if "time_s" in words.columns.values():
        return _time_series(raw, words)
    matched = {header: match_column(header, SERIES_COLUMNS) for header in raw.headers}
    clock = next((header for header, column in matched.items() if column and column.name == "time_s"), None)
    if clock is None:
        return _bench_table(raw, words)
    step = _step_of_moments(raw, clock)
    if step < _PROTOCOL_STEP_S:
        return _time_series(raw, words)
    bench = _bench_table(raw, replace(words, columns={clock: "order", **words.columns}))
    facts = {"header": quoted(clock), "least": _PROTOCOL_STEP_S, "option": column_option(clock, "time_s")}
    return replace(bench, findings=(finding("protocol", size=step, column="order", **facts), *bench.findings))


def _step_of_moments(raw: RawTable, header: str) -> float:
    """Median time in s between the times of day, the minutes or the hours that somebody wrote beside the readings.

    0 for other columns: a recorder counts in seconds or less.
    """
    place, factor = raw.headers.index(header), unit_factor(parse_header(header).unit or "s", "s") or 1.0
    moments = clock_seconds(raw.texts(place), header)
    if moments is None and factor >= 60.0:
        moments = factor * raw.column(place)
    rising = np.zeros(0) if moments is None else np.sort(moments[np.isfinite(moments)])
    return float(np.median(np.diff(rising))) if len(rising) > 1 else 0.0


def read_bench_table(path: str | Path, *, planned: bool = False, **words: Any) -> BenchTable:
    """Read and check a bench measurement, or a plan of one, with the words of :func:`read_measurement`.

    Rows stand in the order of measuring, with what the checks set aside as NaN and said in ``findings``. In a plan a
    channel counts as given by its column alone, its cells may be empty.
    """
    reading = words_of(Path(path), Words(**{key: word for key, word in words.items() if word is not None}))
    return _bench_table(read_raw_table(Path(path), kinds=(BENCH, IMPEDANCES), words=reading), reading, planned)


def _bench_table(raw: RawTable, words: Words, planned: bool = False) -> BenchTable:
    impedance = IMPEDANCES.fits(raw, words)
    table = read_columns(raw, IMPEDANCES if impedance else BENCH, words)
    read, used, findings = in_series(table, raw) if impedance else table
    of_circuits = tuple(str(name) for name in read if parts_of(str(name))[1])
    channels = (*CHANNELS, *of_circuits)
    empty = set(channels if planned else ()) & set(read)
    held = empty | {name for name in read if read[name].notna().any()}
    filled = tuple(name for name in (*BENCH_COLUMNS, *of_circuits) if name in held)
    BENCH.require(filled, raw.headers, raw.source, used, findings)
    with_noise = (*CHANNELS, "distance_m", "current_A", IMPEDANCE_SHARE, *of_circuits)
    noise, unused = declared_noise(words, (*with_noise, *(OF_RUNS + name for name in channels)), used)
    # Without a column no current flows: right for a pair of magnets, and refused beside a model with a circuit
    absent = SETTINGS | dict.fromkeys(channels, np.nan) | {"current_A": np.nan if of_circuits else 0.0}
    columns = {name: read.get(name, missing) for name, missing in absent.items()}
    rows = pd.DataFrame(columns, index=read.index, dtype=np.float64)
    run = rows["run"].fillna(rows["run"].ffill().fillna(1.0))
    rows = rows.assign(run=run, branch=np.sign(rows["branch"].fillna(0.0)))
    once, remarks = checked(rows[list(filled)], () if planned else (copies,))
    rows, odd = in_measuring_order(rows.loc[once.index], "run" in filled)
    remarks += odd
    if "branch" not in filled and not impedance:
        branch, assumed = branch_from_order(rows)
        remarks += assumed
        rows = rows if branch is None else rows.assign(branch=branch)
    rows, doubts = checked(rows.assign(mount=rows["mount"].fillna(rows["run"])), () if planned else BENCH_CHECKS)
    findings += [*remarks, *unused, *doubts]
    given = tuple(name for name in filled if name in empty or rows[name].notna().any())
    return BenchTable(rows, given, noise, tuple(findings), Path(raw.source).name, **words.texts)


def _time_series(raw: RawTable, words: Words) -> TimeSeries:
    (read, used, findings), names = read_columns(raw, SERIES, words), SERIES.columns(raw.headers, words)
    filled = [name for name in names if name in read and read[name].notna().any()]
    SERIES.require(filled, raw.headers, raw.source, used, findings)
    noise, unused = declared_noise(words, names[names.index(SERIES_CHANNELS[0]) :], used)
    rows = read.reindex(columns=names).astype(np.float64)
    rows["run"] = rows["run"].ffill().fillna(1.0)
    timed = rows["time_s"].notna()
    rows, lost = rows[timed], int((~timed).sum())
    order = np.argsort(pd.factorize(rows["run"])[0], kind="stable")  # rows of one run together
    rows = rows.iloc[order].reset_index(drop=True)
    findings += [finding("cells untimed", size=float(lost), rows=lost)] if lost else []
    rows["segment"], clock = check_clock(rows, raw.source)
    once, repeated = checked(rows[[*filled, "segment"]], (copies,))
    rows, doubts = checked(rows.loc[once.index].reset_index(drop=True), RECORD_CHECKS)
    findings += [*clock, *repeated, *doubts, *unused]
    clipped = {remark.column for remark in doubts if remark.code == "clipped"}
    given = tuple(name for name in filled if name in clipped or rows[name].notna().any())
    return TimeSeries(rows, given, noise, tuple(findings), Path(raw.source).name, **words.texts)


def is_inductance_table(path: Path) -> bool:
    """Tell whether a file holds inductances alone; False for a directory, and where there is no such file."""
    if not path.is_file() or path.suffix not in SUFFIXES:
        return False
    try:
        return read_bench_table(path).channels == ("inductance_H",)
    except TableError:
        return False


def read_inductance_table(path: Path) -> InductanceTable:
    """Read measured inductances, a bench table of ``distance_m, current_A, inductance_H`` in these or other units."""
    bench = read_bench_table(path)
    if lacking := {"current_A", "inductance_H"} - set(bench.given):
        raise refused("no-inductance-table", path=path, lacking=" and ".join(sorted(lacking)))
    d, i, inductance = bench.rows[["distance_m", "current_A", "inductance_H"]].to_numpy().T
    good = np.isfinite(d + i + inductance) & (d >= 0.0) & (i != 0.0) & (inductance > 0.0)
    needed, lost = "distance >= 0, current and inductance > 0", int((~good).sum())
    if not good.any():
        raise TableError(f"{path} has no row with {needed} in it.")
    findings = [finding("cells without", size=float(lost), rows=lost, columns=needed)] if lost else []
    return InductanceTable(d[good], i[good], inductance[good], (*bench.findings, *findings), path.name)
