"""Everything that was found in a FEMM model, and what the user said beside it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from femfit.tables.femm.frame import FemFrame
from femfit.tables.femm.model import FemModel
from femfit.tables.femm.movers import FemBodies
from femfit.tables.femm.options import FemOptions
from femfit.tables.femm.outlines import ArcFinder, Edge, without_holes
from femfit.tables.femm.winding import FemWinding
from femfit.tables.femm.wire import FemWire


@dataclass(frozen=True)
class FemDevice:
    """A model's parts and windings, placed; wires are by the id of their coil."""

    name: str
    model: FemModel
    bodies: FemBodies
    windings: tuple[FemWinding, ...]
    wires: Mapping[int, FemWire]
    frame: FemFrame
    options: FemOptions

    @property
    def distances_mm(self) -> list[float]:
        """Of the sweep."""
        return own_point_added(self.options.distances_mm, self.frame.distance_mm)

    def currents(self, winding: FemWinding) -> list[float]:
        """Of the sweep in A, in one circuit."""
        return own_point_added(self.options.currents_A, self.frame.current(winding))

    def outlines(self) -> dict[int, list[list[Edge]]]:
        """Outlines in the actuator file of each part and coil, by its id."""
        fixed, moving = self.bodies.standing, self.bodies.mover
        simple = {id(piece): without_holes(piece.polygon) for piece in [*fixed, *moving]}
        every = [polygon for pieces in simple.values() for polygon in pieces]
        finder = ArcFinder(self.model.lines, every, self.options.arc_degrees)
        return {
            id(piece): [self.frame.placed(finder.outline(polygon), moving=moves) for polygon in simple[id(piece)]]
            for moves, pieces in ((False, fixed), (True, moving))
            for piece in pieces
        }


def own_point_added(values: Sequence[float], drawn: float) -> list[float]:
    """An axis with the file's own value in its place."""
    return sorted([*(value for value in values if not math.isclose(value, drawn, rel_tol=1e-9, abs_tol=1e-9)), drawn])
