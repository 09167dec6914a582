"""Parquet tables: the same columns as a text table, without its ambiguities."""

import io

import numpy as np
import pandas as pd
import pyarrow as pa

from femfit.core.errors import TableError
from femfit.tables.foreign.raw_table import RawTable

MAGIC = b"PAR1"


def parse_parquet_table(content: bytes, source: str) -> RawTable:
    """Read a Parquet table.

    Returns
    -------
    RawTable
        Columns as they are named; a cell that is no finite number is NaN.

    Raises
    ------
    TableError
        If it is no Parquet that pandas reads.
    """
    try:
        frame = pd.read_parquet(io.BytesIO(content))
    except (OSError, ValueError, pa.ArrowException) as error:
        raise TableError(f"{source} is no Parquet table that can be read: {error}") from error
    if any(isinstance(level, str) or level is not None for level in frame.index.names):
        frame = frame.reset_index()
    columns = [pd.to_numeric(frame.iloc[:, index], errors="coerce") for index in range(frame.shape[1])]
    values = (
        np.array([np.asarray(column, dtype=np.float64) for column in columns]).reshape(frame.shape[1], len(frame)).T
    )
    cells = tuple(tuple(str(cell) for cell in row) for row in frame.itertuples(index=False))
    return RawTable(
        source=source,
        headers=tuple(str(name) for name in frame.columns),
        numbers=np.where(np.isfinite(values), values, np.nan),
        lines=tuple(range(1, len(frame) + 1)),
        cells=cells,
        dialect="Parquet",
    )
