"""Outlines of parts as polygons, with chords for arcs, and the corners at which their fields are singular."""

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely

from femfit.core.arrays import BoolArray, FloatArray
from femfit.device.outlines import flattened
from femfit.device.parts import Actuator, Coil, Material, Region

SMOOTH = math.radians(5.0)
"""A turn of the outline below this is no corner: chords that stand for arcs turn by up to two degrees."""

COINCIDENT = 1e-9
"""Points closer than this, in m, are one."""


def part_corners(part: Region | Coil) -> tuple[tuple[float, float], ...]:
    """Corners of the part in m, with chords for its arcs."""
    return tuple(flattened(part.vertices_m, part.bulges if isinstance(part, Region) else ()))


def polygon(part: Region | Coil) -> shapely.Polygon:
    """The part's section, as drawn."""
    return shapely.Polygon(part_corners(part))


def moving_parts(actuator: Actuator) -> list[Region | Coil]:
    """Regions and coils of the moving part."""
    return [*actuator.moving.regions, *(coil for coil in actuator.coils if coil.moves)]


def fixed_parts(actuator: Actuator) -> list[Region | Coil]:
    """Regions and coils that stand still."""
    return [*actuator.fixed, *(coil for coil in actuator.coils if not coil.moves)]


def singular_corners(regions: Sequence[Region]) -> list[BoolArray]:
    """Which corners of each region the field is singular at.

    A corner is one of what the material fills, whichever regions it is drawn in: where two of one material meet nothing
    happens, nor where an arc goes on smoothly, nor where an edge meets the axis at a right angle. Where there is
    neither iron nor magnet there is nothing to refine.
    """
    corners: dict[Material, FloatArray] = {}
    for material, of_it in _by_material(regions).items():
        magnetic = material.relative_permeability != 1.0 or material.remanence_T != 0.0
        corners[material] = np.array(list(_corners(shapely.union_all(of_it)) if magnetic else [])).reshape(-1, 2)
    return [
        np.array([np.any(np.hypot(*(corners[region.material] - place).T) < COINCIDENT) for place in region.vertices_m])
        for region in regions
    ]


def _by_material(regions: Iterable[Region]) -> dict[Material, list[shapely.Polygon]]:
    parts: defaultdict[Material, list[shapely.Polygon]] = defaultdict(list)
    for region in regions:
        parts[region.material].append(polygon(region))
    return parts


def _corners(filled: Any) -> Iterable[tuple[float, float]]:
    for one in getattr(filled, "geoms", [filled]):
        for ring in (one.exterior, *one.interiors):
            points = np.array(ring.simplify(0.0).coords)[:-1]
            points = points[np.hypot(*(points - np.roll(points, 1, axis=0)).T) > COINCIDENT]
            for before, here, after in zip(
                np.roll(points, 1, axis=0), points, np.roll(points, -1, axis=0), strict=True
            ):
                if _turn(before, here, after) > SMOOTH:
                    yield tuple(here)


def _turn(before: FloatArray, here: FloatArray, after: FloatArray) -> float:
    """Angle by which an outline turns at a point; on the axis together with its mirror image."""
    steps = [here - before, after - here]
    if here[0] < COINCIDENT:  # one of the edges lies on the axis, the other one goes on mirrored
        (step,) = [one for one in steps if abs(one[0]) > COINCIDENT] or [np.array([1.0, 0.0])]
        return 2.0 * math.atan2(abs(step[1]), abs(step[0]))
    one, other = (step / np.hypot(*step) for step in steps)
    return abs(math.atan2(one[0] * other[1] - one[1] * other[0], one @ other))
