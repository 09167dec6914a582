"""The known columns of a measured file: whether it has them, its cells, and their numbers in SI.

Settings that were the same throughout, and have no column: a distance of a gauge block, a bias current.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from femfit.core.errors import TableError
from femfit.core.results import Finding, listing
from femfit.core.sweep_columns import is_current
from femfit.core.text import amount, counted, quoted
from femfit.tables.circuit_columns import circuit_columns, parts_of
from femfit.tables.columns import UsedColumn, column_values, match_column, match_columns, recognise
from femfit.tables.files import finite_number
from femfit.tables.findings import finding
from femfit.tables.measurement import SETTINGS
from femfit.tables.raw_table import RawTable, file_content
from femfit.tables.table_file import Wanted, parse_table


def has_columns(
    needs: Sequence[frozenset[str]],
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str | float] | None = None,
) -> Callable[[RawTable], bool]:
    """Return whether a table has the columns of one of some sets, as they are recognised and named by the user."""
    names = tuple(sorted(frozenset[str]().union(*needs)))

    def wanted(raw: RawTable) -> bool:
        candidates = (*names, *circuit_columns((*raw.headers, *(columns or {}).values())))
        try:
            used, _, _ = match_columns(raw.headers, raw.source, candidates, columns, units, optional=candidates)
        except TableError:  # it lacks a column that the user named
            return False
        quantities = {parts_of(column.name)[0] for column in used.values()}
        return any(need <= quantities for need in needs)

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
    values, remarks = column_values(raw, used)
    notes = [finding("reading", note=note[0].upper() + note[1:]) for note in raw.notes]
    return values, used, notes + findings + remarks


def constant_settings(settings: object, where: str) -> dict[str, float]:
    """Column to value in SI of what a sidecar or an option says: ``distance_mm = 2.0``."""
    if not isinstance(settings, Mapping):
        raise TableError(
            f"[settings] of {where} must hold lines like distance_mm = 2.0; instead received {quoted(settings)}."
        )
    result, of_circuits = {}, filter(is_current, circuit_columns(map(str, settings), fewest=1))
    names = (*SETTINGS, *of_circuits)
    for key, value in settings.items():
        column, number = match_column(str(key), names), finite_number(value)
        if column is None or column.assumed or number is None:
            raise TableError(
                f"A setting in {where} must be like distance_mm = 2.0, one of {', '.join(SETTINGS)} in any unit, and a "
                f"number; instead received {quoted(f'{key} = {value}')}."
            )
        result[column.name] = column.factor * number
    return result


def with_settings(rows: pd.DataFrame, settings: Mapping[str, float], source: str) -> tuple[pd.DataFrame, list[Finding]]:
    """The rows with columns for constant settings, and what was added."""
    findings = []
    for name, value in settings.items():
        if name in rows and rows[name].notna().any():
            raise TableError(
                f"{source} has a column {name}, so that it is no constant setting. Leave out the setting of "
                f"{amount(value, name, 4)}."
            )
        rows = rows.assign(**{name: value})
        findings.append(finding("constant-setting", column=name, value=amount(value, name, 4)))
    return rows, findings
