"""All windings of a model: its circuits, and the patterns of its eddy currents as windings that are short-circuited.

The equations of motion know no other: L w' = U - R w + k_m v for the currents w = (i, e), where U is 0 for a pattern.
"""

from dataclasses import dataclass

from femfit.core.numerics import FloatArray
from femfit.model.magnetics import Magnetics


@dataclass(frozen=True, eq=False)
class Windings:
    """The n circuits, and after them the r patterns."""

    magnetics: Magnetics  # Of all their currents
    resistances_ohm: FloatArray  # Shape (n + r,)
    series_H: FloatArray  # In series outside of the field, on the diagonal of shape (n + r, n + r)
    circuits: int  # n

    @property
    def count(self) -> int:
        """How many there are, n + r."""
        return len(self.resistances_ohm)

    @property
    def end(self) -> int:
        """Place behind the currents in a state (distance, velocity, currents, ..)."""
        return 2 + len(self.resistances_ohm)
