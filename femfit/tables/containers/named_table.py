"""A table by its name in a file that may hold several."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from femfit.core.errors import TableError
from femfit.tables.raw_table import RawTable, raw_table_of

Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class NamedTable:
    """One sheet, group, struct or array of a file."""

    name: str
    raw: RawTable
    wider: RawTable | None = None  # The same with the columns of the groups around it, such as one common clock


def table_of_columns(name: str, columns: Columns, source: str, kind: str, outer: Columns | None = None) -> NamedTable:
    """Return columns of one length as a table; those of the groups around it count where a name is free."""
    around = {header: column for header, column in (outer or {}).items() if header not in columns}
    wider = raw_table_of(_frame({**around, **columns}), source, kind) if around else None
    return NamedTable(name, raw_table_of(_frame(columns), source, kind), wider)


def _frame(columns: Columns) -> pd.DataFrame:
    native = {name: np.asarray(column, column.dtype.newbyteorder("=")) for name, column in columns.items()}
    return pd.DataFrame(native)


def require_library(module: str, package: str, source: str) -> None:
    """Refuse a file where the optional library that its kind needs is not installed."""
    if find_spec(module) is None:
        raise TableError(
            f"To read {source}, femfit needs the package {package}, which is not installed. Install it with "
            "pip install 'femfit[files]', or export the table as CSV."
        )
