"""The cells of a measured file, before they mean anything: CSV or Parquet to text, text to numbers in SI."""

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from femfit.core.errors import TableError
from femfit.tables.decode import decode
from femfit.tables.measurement_columns import UsedColumn
from femfit.tables.units import is_unit

_BRANCH_WORDS = {
    **dict.fromkeys(("rising", "rise", "up", "+", "increasing", "ascending", "steigend", "auf", "hin"), 1.0),
    **dict.fromkeys(("falling", "fall", "down", "-", "decreasing", "descending", "fallend", "ab", "zurück"), -1.0),
}
_LABELS = ("run", "mount")
_DELIMITERS = (";", "\t", ",")
_NO_UNIT = ("", "-", "1")


def read_cells(path: Path) -> pd.DataFrame:
    """The cells of a file under its own headers.

    Parameters
    ----------
    path : Path
        ``.csv`` (commas, semicolons or tabs; decimal point or comma; lines that start with # are passed over) or
        ``.parquet``.

    Returns
    -------
    DataFrame
        Text, or numbers where the file has types.

    Raises
    ------
    TableError
        If there is no such file, or it is no table.
    """
    if not path.is_file():
        raise TableError(f"There is no measurement {path}. Give a .csv or .parquet file.")
    return _parquet(path) if path.suffix == ".parquet" else _csv(path)


def _csv(path: Path) -> pd.DataFrame:
    text, _ = decode(path.read_bytes(), str(path))
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise TableError(f"{path} is empty; it needs a header line and rows of numbers.")
    lines, delimiter = _from_header(lines)
    try:
        table = pd.read_csv(io.StringIO("\n".join(lines)), sep=delimiter, dtype=str, skipinitialspace=True)
    except (ValueError, pd.errors.ParserError) as error:
        said = " ".join(str(error).split())
        raise TableError(
            f"{path} must have one row a reading below one line of column names; instead: {said}. Remove what stands "
            "above and below the table."
        ) from error
    if not isinstance(table.index, pd.RangeIndex):
        raise TableError(f"{path} must have as many headers as columns; its rows are longer than its header line.")
    if delimiter != ",":  # a decimal comma
        table = table.apply(lambda column: column.str.replace(",", ".", regex=False))
    unnamed = [name for name in table.columns if str(name).startswith("Unnamed: ") and table[name].isna().all()]
    return table.drop(columns=unnamed)


def _from_header(lines: list[str]) -> tuple[list[str], str]:
    """The lines from the column names on, and what separates their cells.

    The names are the last line of words above the first line of as many cells with a number in them; a line of units
    below them is joined with them. Lines above, as measuring programs write them, are left out.
    """
    for k in range(1, len(lines)):
        for delimiter in _DELIMITERS:
            names, row = _cells(lines[k - 1], delimiter), _cells(lines[k], delimiter)
            if len(names) < 2 or len(row) != len(names) or any(map(_is_number, names)) or not any(map(_is_number, row)):
                continue
            above = _cells(lines[k - 2], delimiter) if k > 1 else []
            units = [name.strip("[]() ") for name in names]
            if len(above) == len(names) and any(units) and all(unit in _NO_UNIT or is_unit(unit) for unit in units):
                joined = [
                    one if unit in _NO_UNIT else f"{one} [{unit}]" for one, unit in zip(above, units, strict=True)
                ]
                return [delimiter.join(f'"{one}"' for one in joined), *lines[k:]], delimiter
            return lines[k - 1 :], delimiter
    return lines, max(_DELIMITERS, key=lines[0].count)


def _cells(line: str, delimiter: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _parquet(path: Path) -> pd.DataFrame:
    try:
        return pd.read_parquet(path)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise TableError(f"{path} cannot be read as Parquet: {error}") from error


def cell_numbers(column: "pd.Series[Any]", one: UsedColumn) -> tuple[np.ndarray[Any, Any], list[str]]:
    """A column as float64 in SI.

    Parameters
    ----------
    column : Series
        As :func:`read_cells` gives it.

    Returns
    -------
    tuple of array and list of str
        NaN where a cell is empty or no finite number, which the sentences tell.
    """
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
