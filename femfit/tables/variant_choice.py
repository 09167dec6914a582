"""One variant out of a parameter sweep's table, with what its model needs beside the rows."""

import difflib
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray
from femfit.core.sweep_columns import VARIANT
from femfit.tables.sweep_table import SweepTable

SAME = 1e-6
"""Values that agree to this part are the same: nobody types a drawn sample's sixteen digits."""

SHOWN = 6


def choose_variant(table: SweepTable, where: Mapping[str, float | str]) -> SweepTable:
    """Return the rows of one variant as a sweep table of their own, with the variant's actuator.

    ``where`` has values by the column of the parameter, or of ``variant``, text for a material; it is empty for a table
    without parameters.
    """
    names = [str(name) for name in table.rows.columns]
    axes = names[names.index(VARIANT) :] if VARIANT in names else []
    rows = table.rows
    for name, value in where.items():
        rows = _narrowed(rows, name, value, axes)
    if not axes:
        return table
    variants = rows[axes].drop_duplicates()
    if len(variants) > 1:
        raise TableError(
            f"One actuator's rows are needed; the table holds {len(variants)} variants ({_varying(variants)}). Choose "
            f"one with --where {VARIANT}={variants[VARIANT].iloc[0]}, or by its parameters, for example "
            f"--where {axes[-1]}={_shown(variants[axes[-1]].iloc[0])}; repeat --where for more of them."
        )
    chosen = {name: variants[name].tolist()[0] for name in axes}
    return SweepTable(rows.drop(columns=axes).reset_index(drop=True), _manifest(table.manifest, chosen))


def _narrowed(rows: pd.DataFrame, name: str, value: float | str, axes: list[str]) -> pd.DataFrame:
    if name not in axes:
        near = difflib.get_close_matches(name, axes, n=1, cutoff=0.4)
        axes_text = f"its parameters are {', '.join(axes)}" if axes else "it has none: leave --where out"
        raise TableError(
            f"{name!r} is no parameter of the table; {axes_text}." + (f" Did you mean {near[0]!r}?" if near else "")
        )
    matching: pd.DataFrame = rows[_same(rows[name], value)]
    if matching.empty:
        raise TableError(
            f"No row has {name} = {_shown(value)} with what else was chosen; {name} {_values(rows[name])} there. "
            "Choose one of these."
        )
    return matching


def _same(column: "pd.Series[Any]", value: float | str) -> BoolArray:
    if not is_numeric_dtype(column):
        return np.array([str(cell) == _shown(value) for cell in column])
    if isinstance(value, str):
        return np.zeros(len(column), dtype=np.bool_)
    return np.asarray(np.isclose(column.to_numpy(dtype=float), value, rtol=SAME, atol=0.0))


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def _varying(variants: pd.DataFrame) -> str:
    return "; ".join(f"{name} {_values(variants[name])}" for name in variants.columns if len(set(variants[name])) > 1)


def _values(column: "pd.Series[Any]") -> str:
    values = sorted(set(column))
    shown = ", ".join(_shown(value) for value in values[:SHOWN])
    return f"is {shown}" if len(values) <= SHOWN else f"is {shown}, ... {_shown(values[-1])}"


def _manifest(manifest: Mapping[str, Any], chosen: Mapping[str, Any]) -> dict[str, Any]:
    general = {name: value for name, value in manifest.items() if name not in {"variants", "parameters"}}
    for entry in manifest.get("variants", ()):
        if entry.get(VARIANT) == chosen[VARIANT]:
            general |= {name: value for name, value in entry.items() if name in general}
    return general | {"variant": dict(chosen)}
