"""A winding that touches what moves against it gives way by a clearance that hardly changes its field."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import shapely
from shapely import Polygon, box

from femfit.tables.femm.faces import GRID
from femfit.tables.femm.movers import Body, FemBodies
from femfit.tables.femm.notes import Notes
from femfit.tables.femm.parse import DIGITS
from femfit.tables.femm.winding import FemCoil, FemWinding

CLEARANCE = 0.02
"""Of the winding's smaller side: the field changes less than by the tolerance of a winding's mean radius."""


def trim_windings(
    windings: Sequence[FemWinding], bodies: FemBodies, notes: Notes
) -> tuple[tuple[FemWinding, ...], FemBodies]:
    """Windings that touch the other body keep clear of it, in the windings and in the bodies alike."""
    trimmed = {id(coil): _trimmed(coil, bodies.mover, notes) for coil in bodies.fixed_coils}
    standing: Body = [*bodies.fixed, *(trimmed[id(coil)] for coil in bodies.fixed_coils)]
    trimmed |= {id(coil): _trimmed(coil, standing, notes) for coil in bodies.moving_coils}
    return (
        tuple(replace(winding, coils=tuple(trimmed[id(coil)] for coil in winding.coils)) for winding in windings),
        replace(
            bodies,
            fixed_coils=tuple(trimmed[id(coil)] for coil in bodies.fixed_coils),
            moving_coils=tuple(trimmed[id(coil)] for coil in bodies.moving_coils),
        ),
    )


def _trimmed(coil: FemCoil, obstacles: Body, notes: Notes) -> FemCoil:
    """The winding with all its turns on a section that keeps clear of the others, if it touches one of them."""
    contacts = [obstacle.polygon.intersection(coil.polygon) for obstacle in obstacles]
    touching = shapely.union_all([contact for contact in contacts if not contact.is_empty])
    if touching.is_empty:
        return coil
    r0, z0, r1, z1 = coil.polygon.bounds
    clearance = round(CLEARANCE * min(r1 - r0, z1 - z0), DIGITS)
    section = coil.polygon.difference(_around(touching, coil.polygon, clearance), grid_size=GRID)
    if not isinstance(section, Polygon) or section.interiors or section.is_empty:
        notes.problem(f"{coil.labels[0].place} touches what moves against it on all sides. Draw a gap around it.")
        return coil
    notes.warn(
        "trimmed-winding",
        f"{coil.labels[0].place} touches what moves against it; its section keeps {clearance:g} mm clear, with all "
        "its turns.",
        "Draw the clearance that the winding has.",
    )
    return replace(coil, polygon=section)


def _around(touching: shapely.Geometry, winding: Polygon, clearance: float) -> shapely.Geometry:
    """What a winding gives up: along straight sides its whole length, for the other body slides along them."""
    r0, z0, r1, z1 = winding.bounds
    strips = []
    for line in shapely.get_parts(shapely.get_parts(touching)):
        ends = shapely.get_coordinates(line)
        for (r, z), (r_next, z_next) in pairwise(ends.tolist()):
            if abs(r_next - r) <= GRID:
                strips.append(box(r - clearance, z0, r + clearance, z1))
            elif abs(z_next - z) <= GRID:
                strips.append(box(r0, z - clearance, r1, z + clearance))
        strips.append(line.buffer(clearance))
    return shapely.union_all(strips)
