"""A stretch of a coil record: what a search coil, a Hall probe and a current sensor read. numpy only."""

from dataclasses import dataclass

from femfit.core.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class CoilBlock:
    """Consecutive samples of a coil record; one sample is a block too.

    Parameters
    ----------
    time : array, shape (n,)
        In s, rising.
    voltage : array, shape (n,)
        Of the coil in V; positive for a rising field.
    hall : array, shape (n,), or None
        Hall probe's reading in T; NaN where there is none.
    current : array, shape (n,), or None
        Excitation current in A.
    """

    time: FloatArray
    voltage: FloatArray
    hall: FloatArray | None = None
    current: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: slice | IntArray | BoolArray) -> "CoilBlock":
        def part(column: FloatArray | None) -> FloatArray | None:
            return None if column is None else column[rows]

        return CoilBlock(self.time[rows], self.voltage[rows], part(self.hall), part(self.current))
