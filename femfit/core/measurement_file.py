"""Bench measurement files, CSV or Parquet with an optional sidecar, to checked tables."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from femfit.core.decode import decode
from femfit.core.errors import TableError
from femfit.core.measurement import CHANNELS, SETTINGS, BenchTable
from femfit.core.measurement_columns import UsedColumn, recognise
from femfit.core.measurement_sidecar import read_sidecar

_BRANCH_WORDS = {
    **dict.fromkeys(("rising", "rise", "up", "+"), 1.0),
    **dict.fromkeys(("falling", "fall", "down", "-"), -1.0),
}
_LABELS = ("run", "mount")
_DELIMITERS = (";", "\t", ",")


def read_bench_table(path: Path, *, planned: bool = False) -> BenchTable:
    """Read and check a bench measurement.

    Parameters
    ----------
    path : Path
        ``.csv`` (commas, semicolons or tabs; decimal point or comma; lines that start with # are passed over) or
        ``.parquet``; ``NAME.toml`` or ``NAME.csv.toml`` beside it may declare the noise.
    planned : bool
        Whether it is a plan: a channel counts as given by its column alone, its cells may be empty.

    Returns
    -------
    BenchTable
        Rows in the order of measuring, with what the checks set aside as NaN and said in ``findings``.

    Raises
    ------
    TableError
        If there is no such file, it is no table, or it lacks a current, a distance or any channel.
    """
    path = Path(path)
    if not path.is_file():
        raise TableError(f"There is no measurement {path}. Give a .csv or .parquet file.")
    raw = _parquet(path) if path.suffix == ".parquet" else _csv(path)
    used, findings = recognise(map(str, raw.columns), str(path))
    names = [one.name for one in used]
    _require(names, path)
    columns = {}
    for one in used:
        columns[one.name], said = _numbers(raw[one.header], one)
        findings += said
    sidecar = read_sidecar(path)
    rows = pd.DataFrame(columns)
    given = tuple(
        name
        for name in (*SETTINGS, *CHANNELS)
        if name in rows and (bool(rows[name].notna().any()) or (planned and name in CHANNELS))
    )
    _require(given, path)
    return BenchTable(
        rows=_complete(rows),
        given=given,
        declared_noise=sidecar.noise,
        findings=(*findings, *sidecar.findings),
        source=path.name,
        test_object=sidecar.test_object,
        notes=sidecar.notes,
    )


def _csv(path: Path) -> pd.DataFrame:
    text, _ = decode(path.read_bytes(), str(path))
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise TableError(f"{path} is empty; it needs a header line and rows of numbers.")
    delimiter = max(_DELIMITERS, key=lines[0].count)
    try:
        table = pd.read_csv(io.StringIO("\n".join(lines)), sep=delimiter, dtype=str, skipinitialspace=True)
    except (ValueError, pd.errors.ParserError) as error:
        raise TableError(f"{path} is no table with one row a reading: {error}.") from error
    if not isinstance(table.index, pd.RangeIndex):
        raise TableError(f"{path} must have as many headers as columns; its rows are longer than its header line.")
    if delimiter != ",":  # a decimal comma
        table = table.apply(lambda column: column.str.replace(",", ".", regex=False))
    return table


def _parquet(path: Path) -> pd.DataFrame:
    try:
        return pd.read_parquet(path)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise TableError(f"{path} cannot be read as Parquet: {error}") from error


def _require(names: "list[str] | tuple[str, ...]", path: Path) -> None:
    missing = [name for name in ("current_A", "distance_m") if name not in names]
    if not any(name in CHANNELS for name in names):
        missing.append(f"one of {', '.join(CHANNELS)}")
    if missing:
        raise TableError(
            f"A bench table must have current_A, distance_m and at least one channel, with numbers in them; {path} "
            f"lacks {' and '.join(missing)} (it has {', '.join(names) or 'none of the known columns'}). Rename the "
            "columns or add them."
        )


def _numbers(column: "pd.Series[Any]", one: UsedColumn) -> tuple[np.ndarray[Any, Any], list[str]]:
    """A column as float64 in SI, NaN where a cell is empty or no finite number."""
    text = column.astype("string").str.strip()
    empty = text.isna() | (text.str.casefold() == "nan") | (text == "")
    values = pd.to_numeric(text, errors="coerce").to_numpy(dtype=np.float64, na_value=np.nan)
    if one.name == "branch":
        words = text.str.casefold().map(_BRANCH_WORDS).to_numpy(dtype=np.float64, na_value=np.nan)
        values = np.sign(np.where(np.isfinite(words), words, values))
    if one.name in _LABELS and np.isnan(values[~empty]).any():
        code, labels = pd.factorize(text.where(~empty))
        numbered = f"{one.name} was numbered: {', '.join(f'{k + 1} = {label}' for k, label in enumerate(labels))}."
        return np.where(code >= 0, code + 1.0, np.nan), [numbered]
    values = np.where(np.isfinite(values), values, np.nan) * one.factor
    bad = np.flatnonzero(np.isnan(values) & ~empty.to_numpy())
    if not len(bad):
        return values, []
    example = text.iloc[int(bad[0])]
    cells = "1 cell holds" if len(bad) == 1 else f"{len(bad)} cells hold"
    return values, [f"In {one.header} {cells} no number ({example!r}); these readings count as missing."]


def _complete(rows: pd.DataFrame) -> pd.DataFrame:
    """Every column of the contract, rows of one run together in the order of measuring."""
    full = pd.DataFrame({name: rows.get(name, missing) for name, missing in SETTINGS.items()}, index=rows.index)
    full = full.assign(**{name: rows.get(name, np.nan) for name in CHANNELS}).astype(np.float64)
    full["run"] = full["run"].fillna(full["run"].ffill().fillna(1.0))
    full["mount"] = full["mount"].fillna(full["run"])
    full["branch"] = full["branch"].fillna(0.0)
    full["_run"] = pd.factorize(full["run"])[0]
    clocked = full.groupby("run")["order"].transform(lambda order: bool(order.notna().all() and order.is_unique))
    full["_order"] = full["order"].where(clocked.astype(bool), 0.0)
    full = full.sort_values(["_run", "_order"], kind="stable", ignore_index=True).drop(columns=["_run", "_order"])
    full["order"] = full["order"].fillna(full.groupby("run").cumcount().astype(np.float64))
    return full
