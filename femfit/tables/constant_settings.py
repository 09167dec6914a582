"""Settings that were the same throughout, and have no column: a distance of a gauge block, a bias current."""

from collections.abc import Mapping

import pandas as pd

from femfit.core.amount import amount
from femfit.core.errors import TableError
from femfit.core.finding import Finding
from femfit.core.quoted import quoted
from femfit.core.sweep_columns import is_current
from femfit.tables.circuit_columns import circuit_columns
from femfit.tables.columns import match_column
from femfit.tables.measurement import SETTINGS
from femfit.tables.settings_file import finite_number


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
        text = f"{name} was set to {amount(value, name, 4)} in every row, as declared."
        findings.append(Finding("constant-setting", "info", text, column=name))
    return rows, findings
