"""Layout of a drawing for meshes: outlines, lengths over its sweep, distances that share a mesh, names of regions.

Outlines are polygons with chords for arcs, whose corners are where fields are singular. A part with a material is
``fixed:NAME`` or ``moving:NAME``, a coil ``fixed_coil:NAME`` or ``moving_coil:NAME``; around the moving part lie
``halo`` and ``layer``, and ``air`` is all the rest.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from typing import Any

import numpy as np
import shapely

from femfit.core.errors import FieldSolverError
from femfit.core.numerics import FloatArray
from femfit.device.outlines import flattened
from femfit.device.parts import Actuator, Coil, Material, Region
from femfit.field.tolerance import SolverSettings

SMOOTH = math.radians(5.0)
"""A turn of the outline below this is no corner: chords that stand for arcs turn by up to two degrees."""

COINCIDENT = 1e-9
"""Points closer than this, in m, are one."""


def parts_of(actuator: Actuator) -> dict[str, Region | Coil]:
    """All parts by the names of their regions in the mesh: the fixed ones, the moving ones, then the coils."""
    parts: dict[str, Region | Coil] = {f"fixed:{region.name}": region for region in actuator.fixed}
    parts |= {f"moving:{region.name}": region for region in actuator.moving.regions}
    return parts | {coil_region(coil): coil for coil in actuator.coils}


def bulges_of(shape: Region | Coil) -> tuple[float, ...]:
    """Of the part's edges, as in :mod:`femfit.device.outlines`; empty where all are straight."""
    return shape.bulges if isinstance(shape, Region) else ()


def part_corners(shape: Region | Coil) -> tuple[tuple[float, float], ...]:
    """Corners of the part in m, with chords for its arcs."""
    return tuple(flattened(shape.vertices_m, bulges_of(shape)))


def polygon(shape: Region | Coil) -> shapely.Polygon:
    """The part's section, as drawn."""
    return shapely.Polygon(part_corners(shape))


def moving_parts(actuator: Actuator) -> list[Region | Coil]:
    """Regions and coils of the moving part."""
    return [part for name, part in parts_of(actuator).items() if name.startswith("moving")]


def fixed_parts(actuator: Actuator) -> list[Region | Coil]:
    """Regions and coils that stand still."""
    return [part for name, part in parts_of(actuator).items() if name.startswith("fixed")]


def singular_corners(regions: Sequence[Region]) -> dict[Material, FloatArray]:
    """Where the field is singular, at corners (n, 2) of what each material fills, in m.

    A corner is one of what the material fills, whichever regions it is drawn in: where two of one material meet nothing
    happens, nor where an arc goes on smoothly, nor where an edge meets the axis at a right angle. Where there is
    neither iron nor magnet there is nothing to refine.
    """
    parts: defaultdict[Material, list[shapely.Polygon]] = defaultdict(list)
    for region in regions:
        magnetic = region.material.relative_permeability != 1.0 or region.material.remanence_T
        parts[region.material] += [polygon(region)] if magnetic else []
    return {
        material: np.array([*_corners(shapely.union_all(of_it))]).reshape(-1, 2) for material, of_it in parts.items()
    }


def _corners(filled: Any) -> Iterable[tuple[float, float]]:
    """The corners of what a material fills, on the axis those of the outline together with its mirror image."""
    for piece in getattr(filled, "geoms", [filled]):
        for ring in (piece.exterior, *piece.interiors):
            points = np.array(ring.simplify(0.0).coords)[:-1]
            points = points[np.hypot(*(points - np.roll(points, 1, axis=0)).T) > COINCIDENT]
            before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
            across = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
            turn = np.abs(np.arctan2(across, (before * after).sum(axis=1)))
            # One of the edges lies on the axis, the other one goes on mirrored
            leaving = np.where(np.abs(before[:, :1]) > COINCIDENT, before, after)
            mirrored = 2.0 * np.arctan2(np.abs(leaving[:, 1]), np.abs(leaving[:, 0]))
            yield from map(tuple, points[np.where(points[:, 0] < COINCIDENT, mirrored, turn) > SMOOTH])


INNER_OFFSET, OUTER_OFFSET = 0.2, 0.6  # of the clearance
LARGEST_OFFSET = 1.5  # of the moving part's smaller extent: a far larger layer only costs elements
LEAST_GAP = 0.2  # of the clearance: a shorter length is not stretched


Span = tuple[float, float]
"""The lowest and the highest of some heights in m."""


@dataclass(frozen=True)
class Layout:
    """Lengths that the mesh and its motion are built from, in m."""

    clearance: float  # Smallest distance between the moving part and any other part or sensor over the sweep
    nearest: float  # Smallest distance that the layer has to leave room at
    # Distances of the layer's two outlines from the moving part, where the room is smallest
    inner_offset: float
    outer_offset: float
    # Heights of all edges that a stretch along z would bend or shift, all but vertical ones: of the fixed parts and the
    # Hall element, and of the moving part at distance zero
    fixed: tuple[Span, ...]
    moving: tuple[Span, ...]
    radius: float  # Largest distance of any part from the origin, over the sweep
    outer_radius: float

    def stack(self, distance: float) -> list[tuple[float, float, bool]]:
        """Heights from the lowest on that shift as one, at a distance: (low, high, whether they are the moving part's).

        Those of the moving part have the layer around them.
        """
        lower, upper = distance - self.outer_offset, distance + self.outer_offset
        moving = _joined((low + lower, high + upper) for low, high in self.moving)
        return sorted([(*span, False) for span in self.fixed] + [(*span, True) for span in moving])

    def gaps(self, distance: float) -> FloatArray:
        """The lengths in m, from the lowest on, that grow or shrink where the moving part shifts."""
        return np.array(
            [above[0] - below[1] for below, above in pairwise(self.stack(distance)) if below[2] != above[2]]
        )


def _joined(spans: Iterable[Span]) -> tuple[Span, ...]:
    """The same heights, those that overlap as one span."""
    joined: list[Span] = []
    for low, high in sorted(spans):
        overlaps = joined and low <= joined[-1][1] + COINCIDENT
        start, end = joined.pop() if overlaps else (low, high)
        joined.append((start, max(end, high)))
    return tuple(joined)


def _spans(parts: Iterable[Region | Coil]) -> Iterable[Span]:
    """Heights of the parts' edges that are not vertical."""
    for part in parts:
        corners = part_corners(part)
        for (r0, z0), (r1, z1) in zip(corners, (*corners[1:], corners[0]), strict=True):
            if abs(r1 - r0) > COINCIDENT:
                yield min(z0, z1), max(z0, z1)


def layout_of(actuator: Actuator, settings: SolverSettings) -> Layout:
    """Measure an actuator over its sweep."""
    mover, still = mover_outline(actuator), obstacles(actuator)
    distances = (min(actuator.sweep.distances_m), max(actuator.sweep.distances_m))
    clearance, scale = _clearance(mover, shapely.union_all(still), distances)
    moved = np.concatenate([np.asarray(mover.exterior.coords) + np.array([0.0, d]) for d in distances])
    parts = [*(np.asarray(outline.exterior.coords) for outline in still if outline.geom_type == "Polygon"), moved]
    radius = max(float(np.hypot(*points.T).max()) for points in parts)
    hall = [] if actuator.hall is None else [(actuator.hall.height_m, actuator.hall.height_m)]
    return Layout(
        clearance=clearance,
        nearest=distances[0],
        inner_offset=INNER_OFFSET * scale,
        outer_offset=OUTER_OFFSET * scale,
        fixed=_joined([*_spans(fixed_parts(actuator)), *hall]),
        moving=_joined(_spans(moving_parts(actuator))),
        radius=radius,
        outer_radius=settings.outer_radius_factor * radius,
    )


def layout_of_group(actuator: Actuator, group: tuple[float, ...], layout: Layout, settings: SolverSettings) -> Layout:
    """The layout for the mesh of a group of ascending distances in m, whose layer is as wide as there is room for.

    A layer as thin as the sweep's narrowest gap would cover a far moving part with elements of that size.
    """
    near, far = group[0], group[-1]
    outer = OUTER_OFFSET * _clearance(mover_outline(actuator), shapely.union_all(obstacles(actuator)), (near, far))[1]
    if far > near:  # (gap + far - near - outer) / (gap - outer) within the limit, gap being the shortest to the body
        gap = min(replace(layout, outer_offset=0.0).gaps(distance).min() for distance in (near, far))
        outer = min(outer, gap - (far - near) / (settings.stretch_limit - 1.0))
    outer = max(outer, layout.outer_offset)
    return replace(layout, nearest=near, inner_offset=INNER_OFFSET / OUTER_OFFSET * outer, outer_offset=outer)


def obstacles(actuator: Actuator) -> list[Any]:
    """All that the moving part and its layer keep away from."""
    fixed: list[Any] = [polygon(fixed_part) for fixed_part in fixed_parts(actuator)]
    if actuator.hall is not None:
        fixed.append(shapely.Point(actuator.hall.radius_m, actuator.hall.height_m))
    return fixed


def _clearance(mover: shapely.Polygon, still: Any, distances: tuple[float, float]) -> tuple[float, float]:
    """The smallest distance between moving and fixed parts on the way between two distances, and the offsets' scale."""
    steps = np.linspace(*distances, 65)
    clearance = float(min(still.distance(shapely.affinity.translate(mover, 0.0, d)) for d in steps))
    r0, z0, r1, z1 = mover.bounds
    return clearance, float(min(clearance, LARGEST_OFFSET * min(r1 - r0, z1 - z0)))


def mover_outline(actuator: Actuator) -> shapely.Polygon:
    """Outline of the whole moving part at distance zero."""
    outline = shapely.union_all([polygon(moving_part) for moving_part in moving_parts(actuator)])
    if outline.geom_type != "Polygon":
        raise FieldSolverError(
            "The regions and coils of the moving part must touch each other, so that one closed surface encloses them; "
            f"they form {len(outline.geoms)} separate bodies. Join them by a region of air or another material."
        )
    return outline


def stretch_groups(distances: tuple[float, ...], layout: Layout, settings: SolverSettings) -> list[tuple[float, ...]]:
    """Split ascending distances in m into consecutive groups that share one mesh.

    They do where the same edges are above each other, and no gap of the group has more than the limit's ratio.
    """
    limit, groups = np.log(max(settings.stretch_limit, 1.0 + 1e-9)), list[tuple[float, ...]]()

    def order(distance: float) -> Any:
        """Which spans of heights move, from below; the distance itself where nothing can be stretched."""
        gaps = layout.gaps(distance)
        if settings.stretch_limit <= 1.0 or not gaps.size or gaps.min() <= LEAST_GAP * layout.clearance:
            return distance
        if settings.skin_frequency_Hz:
            return distance  # elements refined at skins are mapped from coarser ones, which do not follow a stretch
        return tuple(span[2] for span in layout.stack(distance))

    for _, alike in groupby(distances, order):
        places = tuple(alike)
        changes = [np.log(layout.gaps(far) / layout.gaps(near)) for near, far in pairwise(places)]
        way = np.append(0.0, np.cumsum([np.abs(change).max() for change in changes]))
        count = max(1, int(np.ceil(way[-1] / limit)))
        if count >= len(places):
            groups += [(d,) for d in places]
            continue
        index = np.clip(np.searchsorted(np.linspace(0.0, way[-1], count + 1), way, side="right") - 1, 0, count - 1)
        cuts = [0, *(np.flatnonzero(np.diff(index)) + 1).tolist(), len(places)]
        groups += [places[a:b] for a, b in pairwise(cuts)]
    return groups


MOVING = "moving(_coil)?:.*"
FIXED = "fixed(_coil)?:.*"

AIR = "air|halo|layer|(fixed|moving)_coil:.*"
"""All regions without a material."""


def coil_region(coil: Coil) -> str:
    """Name of a coil's region."""
    return f"{'moving' if coil.moves else 'fixed'}_coil:{coil.name}"
