"""From the actuator's parts to a mesh: faces, element sizes, the layer that carries the force.

The moving part is wrapped in two offsets of its outline, at a fifth and at three fifths of the clearance to any other
part. The force is evaluated in the layer between the two, which touches no corner; both move with the part.
"""

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np
import shapely
from netgen.libngpy._meshing import NgException
from netgen.occ import Face, Glue, MoveTo, OCCGeometry, WorkPlane
from ngsolve import Mesh

from femfit.core.errors import FieldSolverError
from femfit.device.parts import Actuator, Region
from femfit.field.layout import Layout, layer_outlines, mover_outline
from femfit.field.settings import SolverSettings


def build_mesh(actuator: Actuator, distance: float, layout: Layout, settings: SolverSettings) -> Mesh:
    """Mesh the actuator with its moving part at a distance."""
    try:
        shape = _draw(actuator, distance, layout, settings)
        raw = OCCGeometry(shape, dim=2).GenerateMesh(maxh=layout.outer_radius / 3.0, grading=settings.grading)
    except (NgException, RuntimeError) as error:
        raise FieldSolverError(
            f"The drawing could not be meshed at distance {1e3 * distance:g} mm: {error}. Look for slivers "
            "(parts nearly touching) in the actuator file."
        ) from error
    mesh = Mesh(raw)
    mesh.Curve(settings.order)
    return mesh


def _draw(actuator: Actuator, distance: float, layout: Layout, settings: SolverSettings) -> Any:
    solids = [_part(region, f"fixed:{region.name}", settings) for region in actuator.fixed]
    solids += [
        _part(_shifted(region, distance), f"moving:{region.name}", settings) for region in actuator.moving.regions
    ]
    coil = _face(actuator.coil.vertices_m)
    coil.faces.name = "coil"
    coil.faces.maxh = settings.region_fraction * _extent(actuator.coil.vertices_m)
    outlines = [
        shapely.affinity.translate(one, 0.0, distance)
        for one in (mover_outline(actuator), *layer_outlines(actuator, layout))
    ]
    mover, inner, outer = (_face(tuple(one.exterior.coords)[:-1]) for one in outlines)
    halo, layer = inner - mover, outer - inner
    halo.faces.name, layer.faces.name = "halo", "layer"
    _grade(halo, layer, outlines[1:])
    pieces = [*solids, coil, halo, layer]
    rest = reduce(
        lambda left, right: left - right, [*solids[: len(actuator.fixed)], coil, outer], _half_disc(layout.outer_radius)
    )
    if actuator.hall is not None:
        size = 0.15 * layout.clearance
        disc = WorkPlane().Circle(actuator.hall.radius_m, actuator.hall.height_m, size).Face() * rest
        disc.faces.name, disc.faces.maxh = "air", 0.5 * size
        pieces.append(disc)
        rest = rest - disc
    rest.faces.name = "air"
    shape = Glue([*pieces, rest])
    for edge in shape.edges:
        if np.hypot(edge.center.x, edge.center.y) > 0.6 * layout.outer_radius:
            edge.name = "outer"
    return shape


def _grade(halo: Face, layer: Face, outlines: Sequence[shapely.Polygon]) -> None:
    """Elements as large as the layer is thick, edge by edge of its two outlines."""
    axis = shapely.LineString([(0.0, -1e3), (0.0, 1e3)])
    inner, outer = (outline.exterior - axis for outline in outlines)
    sizes = []
    for edge in layer.edges:
        line = shapely.LineString([(end.x, end.y) for end in (edge.start, edge.end)])
        middle = line.interpolate(0.5, normalized=True)
        near, far = sorted((inner, outer), key=middle.distance)
        if near.distance(middle) < 1e-6 * far.distance(middle):  # not an edge on the axis, between the two
            edge.maxh = line.distance(far)
            sizes.append(edge.maxh)
    halo.faces.maxh = layer.faces.maxh = max(sizes)


def _part(region: Region, name: str, settings: SolverSettings) -> Face:
    face = _face(region.vertices_m)
    extent = _extent(region.vertices_m)
    face.faces.name = name
    face.faces.maxh = settings.region_fraction * extent
    for vertex in face.vertices:
        vertex.maxh = settings.corner_fraction * extent
    return face


def _shifted(region: Region, distance: float) -> Region:
    return Region(region.name, tuple((r, z + distance) for r, z in region.vertices_m), region.material)


def _extent(vertices: tuple[tuple[float, float], ...]) -> float:
    points = np.asarray(vertices)
    return float(np.ptp(points, axis=0).min())


def _face(vertices: tuple[tuple[float, float], ...]) -> Face:
    corners = shapely.geometry.polygon.orient(shapely.Polygon(vertices)).exterior.coords[:-1]
    path = MoveTo(*corners[0])  # counter-clockwise: Open Cascade takes the normal from it
    for corner in corners[1:]:
        path = path.LineTo(*corner)
    return path.Close().Face()


def _half_disc(radius: float) -> Face:
    return WorkPlane().MoveTo(0.0, -radius).Arc(radius, 180.0).Close().Face()
