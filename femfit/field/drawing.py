"""From the actuator's parts to a mesh: faces, element sizes, the layer that carries the force.

The moving part is wrapped in two offsets of its outline, at a fifth and at three fifths of the clearance to any other
part. The force is evaluated in the layer between the two, which touches no corner; both move with the part.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np
import shapely
from netgen.libngpy._meshing import NgException
from netgen.occ import Face, Glue, MoveTo, OCCGeometry, WorkPlane, gp_Vec2d
from ngsolve import CF, Integrate, Mesh

from femfit.core.errors import FieldSolverError
from femfit.device.outlines import Corner, flattened, reversed_outline
from femfit.device.parts import Actuator, Coil, Region
from femfit.field.harmonic import LAYER_FACTOR, skin_layers
from femfit.field.layout import (
    COINCIDENT,
    INNER_OFFSET,
    LARGEST_OFFSET,
    OUTER_OFFSET,
    Layout,
    bulges_of,
    fixed_parts,
    mover_outline,
    obstacles,
    parts_of,
    polygon,
    singular_corners,
)
from femfit.field.tolerance import SolverSettings

EDGE_LENGTH = 2.0
"""Of elements along a thin layer over its thickness: half the elements of 1, and 1.3 times the error (push solenoid,
voice coil and axial bearing; measured with the force of each on finer meshes)."""

HALL_SIZE = 0.15  # of the clearance

THIN = 0.02
"""Of the actuator's radius: elements of a thin layer or conductor are no longer than this, or than it is thick."""

AREA_TOLERANCE = 1e-3
"""Numerical: between a region's area and that of its elements, whose edges are polynomials on arcs."""

LEVEL_RATIO = 4.0  # of the room from one step of the layer's width to the next
MITRE_LIMIT = 1.5  # of the offset: a pointed part's layer is cut off before its tip meets another part
ROUNDING = 0.1  # of the offset: chords of an arc that a layer needs no more of
FLAT = 1e-9
"""Numerical: sine of an angle that rounding makes of none."""

SHORTEST_STEP = 0.02  # of the outer offset: a shorter edge where two steps nearly meet is no use, and may not be meshed

NOT_MAGNETIC = 0.01
"""Of mu_r above 1: copper, aluminium, brass and bronze; without a step of mu no corner is singular."""


def build_mesh(actuator: Actuator, distance: float, layout: Layout, settings: SolverSettings) -> Mesh:
    """Mesh the actuator with its moving part at a distance."""
    try:
        shape = _draw(actuator, distance, layout, settings)
        layers = _mark_skins(shape, actuator, layout, settings)
        raw = OCCGeometry(shape, dim=2).GenerateMesh(maxh=layout.outer_radius / 3.0, grading=settings.grading)
    except (NgException, RuntimeError) as error:
        raise FieldSolverError(
            f"The drawing could not be meshed at distance {1e3 * distance:g} mm: {error}. Look for slivers "
            "(parts nearly touching) in the actuator file."
        ) from error
    mesh = Mesh(raw)
    if layers:
        mesh.RefineHP(layers, LAYER_FACTOR)
    mesh.Curve(settings.order)
    _require_whole(mesh, shape, distance)
    return mesh


def layer_outlines(actuator: Actuator, layout: Layout) -> tuple[shapely.Polygon, shapely.Polygon]:
    """The layer's inner and outer outline round the moving part at distance zero.

    The offsets grow in steps with the room that there is: what of the moving part has a clearance of at least h to all
    fixed parts is wrapped in offsets of h / 5 and 3 h / 5. So a narrow gap makes the layer, and the elements in it,
    thin at the gap alone. No step reaches below the lowest offset, down to which the layer has to move as one where the
    mesh is stretched.
    """
    mover = mover_outline(actuator)
    outlines = [_grown(mover, offset) for offset in (layout.inner_offset, layout.outer_offset)]
    still = shapely.affinity.translate(shapely.union_all(obstacles(actuator)), 0.0, -layout.nearest)
    r0, z0, r1, z1 = mover.bounds
    room = LEVEL_RATIO * layout.outer_offset / OUTER_OFFSET
    while 0.0 < room <= LARGEST_OFFSET * min(r1 - r0, z1 - z0):
        free = mover - still.buffer(room, cap_style="square", join_style="mitre")
        wider = [
            outline | (_grown(free, share * room) & shapely.box(0.0, outline.bounds[1], 1e3, 1e3))
            for outline, share in zip(outlines, (INNER_OFFSET, OUTER_OFFSET), strict=True)
        ]
        if free.is_empty or any(outline.geom_type != "Polygon" or outline.interiors for outline in wider):
            break
        outlines = [without_spikes(outline.simplify(SHORTEST_STEP * layout.outer_offset)) for outline in wider]
        room *= LEVEL_RATIO
    return outlines[0], outlines[1]


def without_spikes(outline: shapely.Polygon) -> shapely.Polygon:
    """An outline without edges that are gone back over, of no width: a mesher counts what lies beside them twice."""
    corners = np.asarray(outline.exterior.coords)[:-1]
    while True:
        before, after = np.roll(corners, 1, axis=0) - corners, np.roll(corners, -1, axis=0) - corners
        length = np.hypot(*before.T) * np.hypot(*after.T)
        across = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        spikes = (np.abs(across) < FLAT * length) & ((before * after).sum(axis=1) > 0.0)
        if not spikes.any():
            return outline
        corners = np.delete(corners, np.flatnonzero(spikes)[0], axis=0)
        outline = shapely.Polygon(corners)


def _grown(outline: Any, offset: float) -> Any:
    """An outline all of whose edges are moved outwards by an offset in m, cut at the axis."""
    grown = outline.buffer(offset, join_style="mitre", mitre_limit=MITRE_LIMIT)
    return grown.simplify(ROUNDING * offset).intersection(shapely.box(0.0, -1e3, 1e3, 1e3))


def _require_whole(mesh: Mesh, shape: Any, distance: float) -> None:
    """Refuse a mesh that covers a region twice or leaves a part of it out, of which Netgen only prints a line."""
    drawn, meshed = defaultdict[str, float](float), defaultdict[str, float](float)
    for face in shape.faces:
        drawn[face.name] += face.mass
    for name, area in zip(mesh.GetMaterials(), Integrate(CF(1.0), mesh, region_wise=True), strict=True):
        meshed[name] += area
    for name, area in drawn.items():
        if abs(meshed[name] - area) > AREA_TOLERANCE * area:
            raise FieldSolverError(
                f"The drawing could not be meshed at distance {1e3 * distance:g} mm: elements cover "
                f"{meshed[name] / area:.3g} times the area of {name}. Look for slivers (parts nearly touching, or "
                "edges that nearly line up) in the actuator file."
            )


def _draw(actuator: Actuator, distance: float, layout: Layout, settings: SolverSettings) -> Any:
    still, mover = (_parts(actuator, distance, layout, settings, moves=moves) for moves in (False, True))
    outlines = [
        shapely.affinity.translate(layer_outline, 0.0, distance) for layer_outline in layer_outlines(actuator, layout)
    ]
    inner, outer = (_face(tuple(outline.exterior.coords)[:-1]) for outline in outlines)
    halo, layer = _without(inner, mover), outer - inner
    halo.faces.name, layer.faces.name = "halo", "layer"
    _grade(halo, layer, outlines, THIN * layout.radius)
    pieces = [*still, *mover, halo, layer]
    half_disc = WorkPlane().MoveTo(0.0, -layout.outer_radius).Arc(layout.outer_radius, 180.0).Close().Face()
    air = _without(half_disc, [*still, outer])
    if actuator.hall is not None:
        hall = shapely.Point(actuator.hall.radius_m, actuator.hall.height_m)
        room = min((polygon(fixed_part).distance(hall) for fixed_part in fixed_parts(actuator)), default=math.inf)
        size = HALL_SIZE * layout.clearance
        if 0.2 * size < room < 1.5 * size:  # or slivers would lie between the disc and the part beside it
            size = 0.5 * room
        disc = WorkPlane().Circle(actuator.hall.radius_m, actuator.hall.height_m, size).Face() * air
        disc.faces.name, disc.faces.maxh = "air", 0.5 * size
        pieces.append(disc)
        air = air - disc
    air.faces.name = "air"
    shape = Glue([*pieces, air])
    for edge in shape.edges:
        if np.hypot(edge.center.x, edge.center.y) > 0.6 * layout.outer_radius:
            edge.name = "outer"
    return shape


def _mark_skins(shape: Any, actuator: Actuator, layout: Layout, settings: SolverSettings) -> int:
    """Mark the surfaces of what conducts; into how many layers the elements at them are to be split."""
    layers = {
        name: skin_layers(part, _largest_element(part, layout, settings), settings.skin_frequency_Hz)
        for name, part in parts_of(actuator).items()
        if isinstance(part, Region)
    }
    for face in shape.faces:
        if layers.get(face.name):
            for edge in face.edges:
                if edge.center.x > COINCIDENT:
                    edge.hpref = 1.0
                    for vertex in edge.vertices:
                        vertex.hpref = 1.0
    return max(layers.values(), default=0)


def _without(face: Face, tools: Sequence[Face]) -> Any:
    return reduce(lambda left, right: left - right, tools, face)


def _grade(halo: Face, layer: Face, outlines: Sequence[shapely.Polygon], longest: float) -> None:
    """Elements in proportion to the layer's thickness, edge by edge of its two outlines."""
    axis = shapely.LineString([(0.0, -1e3), (0.0, 1e3)])
    inner, outer = (outline.exterior - axis for outline in outlines)
    sizes = []
    for edge in layer.edges:
        line = shapely.LineString([(end.x, end.y) for end in (edge.start, edge.end)])
        middle = line.interpolate(0.5, normalized=True)
        near, far = sorted((inner, outer), key=middle.distance)
        if near.distance(middle) < 1e-6 * far.distance(middle):  # not an edge on the axis, between the two
            thickness = line.distance(far)
            edge.maxh = max(thickness, min(EDGE_LENGTH * thickness, longest))
            sizes.append(edge.maxh)
    halo.faces.maxh = layer.faces.maxh = max(sizes)


def _parts(actuator: Actuator, distance: float, layout: Layout, settings: SolverSettings, *, moves: bool) -> list[Face]:
    """Faces of the regions and coils that move, or of those that stand still."""
    prefix, shift = ("moving", distance) if moves else ("fixed", 0.0)
    parts, faces = {name: part for name, part in parts_of(actuator).items() if name.startswith(prefix)}, []
    singular = singular_corners([part for part in parts.values() if isinstance(part, Region)])
    for name, part in parts.items():
        face = _face(part.vertices_m, bulges_of(part), shift)
        face.faces.name, face.faces.maxh = name, _largest_element(part, layout, settings)
        faces.append(face)
        if isinstance(part, Region):
            corners = singular[part.material] + np.array([0.0, shift])
            for vertex in face.vertices:
                if np.any(np.hypot(*(corners - np.array([vertex.p.x, vertex.p.y])).T) < COINCIDENT):
                    vertex.maxh = settings.corner_fraction * _extent(part)
    return faces


def _largest_element(part: Region | Coil, layout: Layout, settings: SolverSettings) -> float:
    """In m; a thin straight conductor without magnetism has long elements, since its field is smooth along it."""
    size = settings.region_fraction * _extent(part)
    if isinstance(part, Coil) or part.bulges or not part.material.conductivity_S_per_m:
        return size
    if part.material.remanence_T or abs(part.material.relative_permeability - 1.0) > NOT_MAGNETIC:
        return size
    r0, z0, r1, z1 = polygon(part).bounds
    return max(size, min(THIN * layout.radius, settings.region_fraction * float(max(r1 - r0, z1 - z0))))


def _extent(shape: Region | Coil) -> float:
    r0, z0, r1, z1 = polygon(shape).bounds
    return float(min(r1 - r0, z1 - z0))


def _face(corners: Sequence[Corner], bulges: Sequence[float] = (), shift: float = 0.0) -> Face:
    """The face inside of an outline of straight edges and arcs."""
    if not shapely.LinearRing(flattened(corners, bulges)).is_ccw:  # Open Cascade takes the normal from it
        corners, bulges = reversed_outline(corners, bulges)
    path = MoveTo(corners[0][0], corners[0][1] + shift)
    for k, start in enumerate(corners):
        stop = corners[(k + 1) % len(corners)]
        bulge = bulges[k] if bulges else 0.0
        if bulge:
            half = -2.0 * math.atan(bulge)  # of the arc's angle, by which its tangent is turned back from the chord
            along, across = stop[0] - start[0], stop[1] - start[1]
            cosine, sine = math.cos(half), math.sin(half)
            tangent = gp_Vec2d(along * cosine - across * sine, along * sine + across * cosine)
            path = path.ArcTo(stop[0], stop[1] + shift, tangent)
        elif k + 1 < len(corners):
            path = path.LineTo(stop[0], stop[1] + shift)
    return path.Close().Face()
