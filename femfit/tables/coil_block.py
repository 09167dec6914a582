"""A stretch of a coil record: what a search coil, a Hall probe and a current sensor read. numpy only."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class CoilBlock:
    """Consecutive samples of a coil record; one sample is a block too."""

    time: FloatArray  # In s, rising; shape (n,)
    voltage: FloatArray  # Of the coil in V; positive for a rising field; shape (n,)
    hall: FloatArray | None = None  # Hall probe's reading in T; NaN where there is none; shape (n,)
    current: FloatArray | None = None  # Excitation current in A; shape (n,)

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: slice | IntArray | BoolArray) -> "CoilBlock":
        def part(column: FloatArray | None) -> FloatArray | None:
            return None if column is None else column[rows]

        return CoilBlock(self.time[rows], self.voltage[rows], part(self.hall), part(self.current))


def joined_record(blocks: Iterable[CoilBlock]) -> CoilBlock:
    """Consecutive coil blocks as one."""
    stretches = list(blocks)

    def column(parts: list[FloatArray | None]) -> FloatArray | None:
        present = [values for values in parts if values is not None]
        return np.concatenate(present) if present else None

    return CoilBlock(
        np.concatenate([block.time for block in stretches]),
        np.concatenate([block.voltage for block in stretches]),
        column([block.hall for block in stretches]),
        column([block.current for block in stretches]),
    )
