"""Time series files, CSV or Parquet with an optional sidecar, to checked series."""

from pathlib import Path

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.tables.measurement_cells import cell_numbers, read_cells
from femfit.tables.measurement_columns import match_column, recognise
from femfit.tables.measurement_sidecar import read_sidecar
from femfit.tables.time_series import SERIES_CHANNELS, SERIES_COLUMNS, TimeSeries
from femfit.tables.time_series_checks import check_clock, check_readings, check_units


def is_time_series(path: Path) -> bool:
    """Whether a measured file is a time series rather than a bench table.

    Parameters
    ----------
    path : Path
        As in :func:`read_time_series`.

    Returns
    -------
    bool
        True if it has a column of times.

    Raises
    ------
    TableError
        If there is no such file, or it is no table.
    """
    used = (match_column(str(header), SERIES_COLUMNS)[0] for header in read_cells(Path(path)).columns)
    return any(column is not None and column.name == "time_s" for column in used)


def read_time_series(path: Path) -> TimeSeries:
    """Read and check a recorded time series.

    Parameters
    ----------
    path : Path
        ``.csv`` or ``.parquet`` as for bench tables; ``NAME.toml`` or ``NAME.csv.toml`` beside it may declare the
        standard deviation of each channel's samples.

    Returns
    -------
    TimeSeries
        Rows in the order of the file, run by run. Nothing is sorted, filled or resampled: where the clock jumps or
        pauses a new segment begins, readings that are stuck or clipped become NaN, and all of it is said.

    Raises
    ------
    TableError
        If there is no such file, it is no table, or it lacks times or any channel.
    """
    path = Path(path)
    raw = read_cells(path)
    used, findings = recognise(map(str, raw.columns), str(path), SERIES_COLUMNS)
    columns = {}
    for one in used:
        columns[one.name], said = cell_numbers(raw[one.header], one)
        findings += said
    given = tuple(name for name in SERIES_COLUMNS if name in columns and bool(np.isfinite(columns[name]).any()))
    _require(given, path)
    sidecar = read_sidecar(path, SERIES_CHANNELS)
    rows, lost = _complete(pd.DataFrame(columns))
    if lost:
        findings.append(f"{lost} rows without a time were left out.")
    rows["segment"], clock = check_clock(rows)
    rows, readings = check_readings(rows)
    return TimeSeries(
        rows=rows,
        given=given,
        declared_noise=sidecar.noise,
        findings=(*findings, *clock, *readings, *check_units(rows), *sidecar.findings),
        source=path.name,
        test_object=sidecar.test_object,
        notes=sidecar.notes,
    )


def _require(given: tuple[str, ...], path: Path) -> None:
    missing = [] if "time_s" in given else ["time_s"]
    if not any(name in SERIES_CHANNELS for name in given):
        missing.append(f"one of {', '.join(SERIES_CHANNELS)}")
    if missing:
        raise TableError(
            f"A time series must have time_s and at least one channel, with numbers in them; {path} lacks "
            f"{' and '.join(missing)} (it has {', '.join(given) or 'none of the known columns'}). Rename the columns "
            "or add them."
        )


def _complete(rows: pd.DataFrame) -> tuple[pd.DataFrame, int]:
    """Every column of the contract, rows of one run together; and how many rows had no time."""
    full = pd.DataFrame({name: rows.get(name, np.nan) for name in SERIES_COLUMNS}, index=rows.index).astype(np.float64)
    full["run"] = full["run"].ffill().fillna(1.0)
    timed = full["time_s"].notna()
    full = full[timed]
    order = np.argsort(pd.factorize(full["run"])[0], kind="stable")
    return full.iloc[order].reset_index(drop=True), int((~timed).sum())
