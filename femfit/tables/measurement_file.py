"""Measured files of any kind, with an optional sidecar, to checked bench tables and time series."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd

from femfit.core.amount import counted
from femfit.core.errors import TableError
from femfit.core.finding import Finding, listing
from femfit.core.quoted import quoted
from femfit.tables.circuit_columns import circuit_columns, parts_of
from femfit.tables.coarse_stamps import spread_stamps
from femfit.tables.column_option import column_option, remedy_for_columns
from femfit.tables.columns import BENCH_COLUMNS, UsedColumn, column_values, match_column, match_columns, recognise
from femfit.tables.header import parse_header
from femfit.tables.measurement import (
    CHANNELS,
    OF_RUNS,
    SERIES_CHANNELS,
    SERIES_COLUMNS,
    SETTINGS,
    BenchTable,
    Measurement,
    TimeSeries,
)
from femfit.tables.measurement_checks import branch_from_order, checked, in_measuring_order, without_copies
from femfit.tables.measurement_sidecar import Reading, read_sidecar, reading_of
from femfit.tables.number_text import clock_seconds
from femfit.tables.raw_table import RawTable, file_content
from femfit.tables.suspected_units import suspected_by_size
from femfit.tables.table_file import Wanted, parse_table
from femfit.tables.time_series_checks import check_clock, check_readings
from femfit.tables.units import unit_factor

BENCH_NEEDS = tuple(frozenset(("distance_m", channel)) for channel in CHANNELS)
SERIES_NEEDS = tuple(frozenset(("time_s", channel)) for channel in SERIES_CHANNELS)
"""Sets of columns, each of which makes a table a measurement."""

_PROTOCOL_STEP_S = 1.0
"""Chosen: a hand writes down no two readings in a second, and no motion of an actuator is sampled so slowly."""


def read_measurement(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str | float] | None = None,
    table: str | None = None,
    noise: Mapping[str, float] | None = None,
) -> Measurement:
    """Read a measured file: a time series where it has a column of times, else a bench table.

    Parameters
    ----------
    path : str or Path
        ``.csv`` (commas, semicolons, tabs or blanks; decimal point or comma; title lines are passed over),
        ``.parquet``, ``.xlsx``, ``.mat``, HDF5, TDMS or ``.wav``; ``NAME.toml`` or ``NAME.csv.toml`` beside it may
        declare the noise.
    columns : mapping of str to str, optional
        Header to the column that it is, where its name does not say it: ``{"Kanal 3": "force_N"}``.
    units : mapping of str to str, optional
        Header to its unit, or to a number that multiplies it to SI: ``{"Kraft": "gf"}``.
    table : str, optional
        Sheet, group or struct, where a file has several that could be meant.
    noise : mapping of str to float, optional
        Channel to the standard deviation of one reading: ``{"force_N": 2e-4}``. All of these may stand in the sidecar
        instead, as ``[columns]``, ``[units]``, ``table`` and ``[noise]``; what is given here counts before it.

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
        raise TableError(
            f"A measurement must be what read_measurement returns, or the path of a file; instead received "
            f"{type(path).__name__}. Give the path of a .csv or .parquet file."
        )
    path = Path(path)
    said = reading_of(path, columns, units, table, noise)
    wanted = has_columns((*BENCH_NEEDS, *SERIES_NEEDS), said.columns, said.units)
    raw = read_raw_table(path, table=said.table, wanted=wanted)
    if "time_s" in said.columns.values():
        return _time_series(raw, path, said)
    matched = {header: match_column(header, SERIES_COLUMNS) for header in raw.headers}
    clock = next((header for header, column in matched.items() if column and column.name == "time_s"), None)
    if clock is None:
        return _bench_table(raw, path, said)
    step = _step_of_moments(raw, clock)
    if step < _PROTOCOL_STEP_S:
        return _time_series(raw, path, said)
    bench = _bench_table(raw, path, replace(said, columns={clock: "order", **said.columns}))
    text = (
        f"The moments in {quoted(clock)!r} are {step:.3g} s apart, where a record over time has samples less than "
        f"{_PROTOCOL_STEP_S:g} s apart: the rows were taken for readings at rest, and the moments for their order. For "
        f"a record, say {column_option(clock, 'time_s')}."
    )
    return replace(bench, findings=(Finding("protocol", "info", text, size=step, column="order"), *bench.findings))


def _step_of_moments(raw: RawTable, header: str) -> float:
    """Median time in s between the times of day, the minutes or the hours that somebody wrote beside the readings.

    0 for other columns: a recorder counts in seconds or less.
    """
    moments = clock_seconds(raw.text(header), header)
    factor = unit_factor(parse_header(header).unit or "s", "s") or 1.0
    if moments is None and factor >= 60.0:
        moments = factor * raw.column(header)
    return 0.0 if moments is None or len(moments) < 2 else float(np.nanmedian(np.diff(np.sort(moments))))


def read_bench_table(
    path: str | Path,
    *,
    planned: bool = False,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str | float] | None = None,
    table: str | None = None,
    noise: Mapping[str, float] | None = None,
) -> BenchTable:
    """Read and check a bench measurement, or a plan of one.

    Rows stand in the order of measuring, with what the checks set aside as NaN and said in ``findings``. In a plan a
    channel counts as given by its column alone, its cells may be empty.
    """
    path = Path(path)
    said = reading_of(path, columns, units, table, noise)
    raw = read_raw_table(path, table=said.table, wanted=has_columns(BENCH_NEEDS, said.columns, said.units))
    return _bench_table(raw, path, said, planned)


def has_columns(
    needs: Sequence[frozenset[str]],
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str | float] | None = None,
) -> Callable[[RawTable], bool]:
    """Return whether a table has the columns of one of some sets, as they are recognised and named by the user."""
    names = tuple(sorted(frozenset[str]().union(*needs)))

    def wanted(raw: RawTable) -> bool:
        known = (*names, *circuit_columns((*raw.headers, *(columns or {}).values())))
        try:
            used, _, _ = match_columns(raw.headers, raw.source, known, columns, units, optional=known)
        except TableError:  # it lacks a column that the user named
            return False
        found = {parts_of(column.name)[0] for column in used.values()}
        return any(need <= found for need in needs)

    return wanted


def read_raw_table(
    path: Path, what: str = "measurement", *, table: str | None = None, wanted: Wanted | None = None
) -> RawTable:
    """Read the cells of a measured file under their headers."""
    raw = parse_table(file_content(path, what), str(path), table=table, wanted=wanted, open_decimal=",")
    if not raw.headers:
        raise TableError(
            f"{path} must have as many column names as columns; there is no line of "
            f"{counted(raw.numbers.shape[1], 'name')} above "
            f"its rows of {counted(raw.numbers.shape[1], 'cell')}. Complete the line of names."
        )
    twice = [header for k, header in enumerate(raw.headers) if header and header in raw.headers[:k]]
    if twice:
        raise TableError(
            f"{path} has more than one column named {listing(dict.fromkeys(twice))}. Rename or remove one."
        )
    return raw


def read_columns(
    raw: RawTable,
    names: Sequence[str],
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str | float] | None = None,
) -> tuple[pd.DataFrame, list[UsedColumn], list[Finding]]:
    """Read what a file has of some columns, in SI."""
    filled = [header for k, header in enumerate(raw.headers) if header or any(raw.texts[k])]
    used, findings = recognise(filled, raw.source, names, columns, units)
    if not len(raw.lines):
        raise TableError(f"{raw.source} has column names and no row below them; it needs one row a reading.")
    values, said = column_values(raw, used)
    notes = [Finding("reading", "info", f"{note[0].upper()}{note[1:]}.") for note in raw.notes]
    return values, used, notes + findings + said


def _bench_table(raw: RawTable, path: Path, said: Reading, planned: bool = False) -> BenchTable:
    of_circuits = circuit_columns((*raw.headers, *said.columns.values()))
    channels = (*CHANNELS, *(name for name in of_circuits if parts_of(name)[0] in CHANNELS))
    known = (*BENCH_COLUMNS, *of_circuits)
    rows, used, findings = read_columns(raw, known, said.columns, said.units)
    unused, named = _unused(raw, used), [column.name for column in used]
    _require("bench table", named, path, unused, _about(findings, named))
    with_noise = (*CHANNELS, "distance_m", "current_A", *of_circuits, *(OF_RUNS + name for name in channels))
    sidecar = read_sidecar(path, with_noise, used, said.noise)
    given = tuple(
        name for name in known if name in rows and (bool(rows[name].notna().any()) or (planned and name in channels))
    )
    _require("bench table", given, path, unused)
    full = _complete_bench(rows, of_circuits)
    copies: list[Finding] = []
    if not planned:
        full, copies = without_copies(full, given)
    ordered, remarks = in_measuring_order(full, "run" in given)
    if "branch" not in given:
        branch, assumed = branch_from_order(ordered)
        remarks += assumed
        ordered = ordered if branch is None else ordered.assign(branch=branch)
    table = BenchTable(
        rows=ordered.assign(mount=ordered["mount"].fillna(ordered["run"])),
        given=given,
        declared_noise=sidecar.noise,
        findings=(*findings, *copies, *remarks, *sidecar.findings),
        source=path.name,
        test_object=sidecar.test_object,
        notes=sidecar.notes,
    )
    return table if planned else checked(table)


def _unused(raw: RawTable, used: Sequence[UsedColumn]) -> list[str]:
    taken = {column.header for column in used}
    return [header for header in raw.headers if header.strip() and header not in taken]


def _about(findings: Sequence[Finding], given: Sequence[str]) -> list[str]:
    return [one.text for one in findings if one.column and one.column not in given]


def _require(kind: str, given: Sequence[str], path: Path, unused: Sequence[str], said: Sequence[str] = ()) -> None:
    """Refuse a bench table or a time series that lacks its first column, or has no channel."""
    first, channels = ("distance_m", CHANNELS) if kind == "bench table" else ("time_s", SERIES_CHANNELS)
    missing: dict[str, tuple[str, ...]] = {} if first in given else {first: (first,)}
    if not any(parts_of(name)[0] in channels for name in given):
        missing[f"one of {', '.join(channels)}"] = channels
    if missing:
        raise TableError(
            f"A {kind} must have {first} and at least one channel, with numbers in them; {path} lacks "
            f"{' and '.join(missing)} (it has {', '.join(given) or 'none of the known columns'}). "
            f"{' '.join([*said[:4], ''])}{remedy_for_columns(unused, [*chain(*missing.values())])}"
        )


def _complete_bench(rows: pd.DataFrame, of_circuits: Sequence[str]) -> pd.DataFrame:
    """Every column of a bench table, in the order of the file, and after them those of several circuits."""
    # Without a column no current flows: right for a pair of magnets, and refused beside a model with a circuit.
    absent = {**SETTINGS, "current_A": np.nan if of_circuits else 0.0}
    full = pd.DataFrame({name: rows.get(name, missing) for name, missing in absent.items()}, index=rows.index)
    full = full.assign(**{name: rows.get(name, np.nan) for name in (*CHANNELS, *of_circuits)}).astype(np.float64)
    return full.assign(
        run=full["run"].fillna(full["run"].ffill().fillna(1.0)), branch=np.sign(full["branch"].fillna(0.0))
    )


def _time_series(raw: RawTable, path: Path, said: Reading) -> TimeSeries:
    of_circuits = circuit_columns((*raw.headers, *said.columns.values()))
    of_circuits = tuple(name for name in of_circuits if parts_of(name)[0] in SERIES_CHANNELS)
    known = (*SERIES_COLUMNS, *of_circuits)
    values, used, findings = read_columns(raw, known, said.columns, said.units)
    given = tuple(name for name in known if name in values and bool(values[name].notna().any()))
    _require("time series", given, path, _unused(raw, used), _about(findings, given))
    sidecar = read_sidecar(path, (*SERIES_CHANNELS, *of_circuits), used, said.noise)
    rows, lost = _complete_series(values, known)
    if lost:
        text = f"{counted(lost, 'row without a time was', 'rows without a time were')} left out."
        findings.append(Finding("cells", "info", text, size=float(lost)))
    rows, coarse = spread_stamps(rows, path.name)
    rows["segment"], clock = check_clock(rows, str(path))
    rows, readings, clipped = check_readings(rows)
    given = tuple(name for name in given if name in clipped or rows[name].notna().any())
    return TimeSeries(
        rows=rows,
        given=given,
        declared_noise=sidecar.noise,
        findings=(*findings, *coarse, *clock, *readings, *suspected_by_size(rows), *sidecar.findings),
        source=path.name,
        test_object=sidecar.test_object,
        notes=sidecar.notes,
        clipped=clipped,
    )


def _complete_series(rows: pd.DataFrame, known: Sequence[str]) -> tuple[pd.DataFrame, int]:
    """Every column of a time series, rows of one run together; and how many rows had no time."""
    full = pd.DataFrame({name: rows.get(name, np.nan) for name in known}, index=rows.index).astype(np.float64)
    full["run"] = full["run"].ffill().fillna(1.0)
    timed = full["time_s"].notna()
    full = full[timed]
    order = np.argsort(pd.factorize(full["run"])[0], kind="stable")
    return full.iloc[order].reset_index(drop=True), int((~timed).sum())
