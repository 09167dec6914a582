"""A foreign table as it stands in its file: headers, numbers, and where each row came from."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray


@dataclass(frozen=True)
class RawTable:
    """Cells of one file, not yet interpreted.

    Parameters
    ----------
    headers : tuple of str
        One a column; empty if the file has none.
    numbers : ndarray, shape (n, m)
        NaN where the cell is no finite number.
    lines : tuple of int, length n
        Line (text) or row (Parquet) of each row in the file, from 1.
    cells : tuple of tuple of str, shape (n, m)
        The text of each cell.
    dialect : str
        Encoding, delimiter and decimal mark in one phrase, for people.
    notes : tuple of str
        What was passed over: comment lines, repeated headers.
    """

    source: str
    headers: tuple[str, ...]
    numbers: FloatArray
    lines: tuple[int, ...]
    cells: tuple[tuple[str, ...], ...]
    dialect: str
    decimal: str = "."
    notes: tuple[str, ...] = ()

    def column(self, header: str) -> FloatArray:
        """Numbers of a column, shape (n,)."""
        return np.array(self.numbers[:, self.headers.index(header)])
