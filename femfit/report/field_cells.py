"""The solved field on small triangles, as many in each element as its polynomials need, and as a file for ParaView.

Neighbouring elements share no point here, so that what jumps between parts (B along a face, H across it, mu_r) jumps in
a picture and in a file too. H follows from B by the material: (B - B_r) / (mu_0 mu_r), or a curve's H(B). A point is
solved for its pictures, and its field also laid on a regular grid of the half section.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from femfit.core.files import write_text
from femfit.core.numerics import MU_0, FloatArray, IntArray
from femfit.device.bh import BHCurve
from femfit.device.parts import AIR, Actuator, LinearMaterial, Material, Region
from femfit.field.layout import polygon
from femfit.field.tolerance import SolverSettings, settings_for
from femfit.report.parts import moving_corners, standing_corners

COLUMNS = 260
"""Points along the radius; a picture of 2 x 260 columns shows no steps at the page's width."""

MARGIN = 0.55
"""Air around the parts, as a part of the electromagnet's radius."""

CORNER_PERCENTILE = 98.0
"""Fields are singular at corners: the largest |B| of a part is that without its highest 2 % of points."""


@dataclass(frozen=True, eq=False)
class SolvedPoint:
    """A solution, A_phi = r w in T m, with its mesh, made at this very distance so that it is not stretched."""

    actuator: Actuator
    distance_m: float
    current_A: float | tuple[float, ...]  # One each of several circuits
    mesh: Any
    w: Any
    force_N: float
    self_force_N: float
    unknowns: int


def solve_point(
    actuator: Actuator, distance: float, current: float | tuple[float, ...], settings: SolverSettings | None = None
) -> SolvedPoint:
    """Solve at one point."""
    from femfit.field.layout import layout_of
    from femfit.field.problem import prepare

    settings = settings or settings_for(actuator)
    asked = np.atleast_2d(current)
    problem = prepare(actuator, (distance,), layout_of(actuator, settings), settings, currents=asked)
    field = problem.field(distance, current)
    return SolvedPoint(
        actuator, distance, current, problem.mesh, field.w, field.force, field.self_force, problem.unknowns
    )


@dataclass(frozen=True, eq=False)
class FieldSample:
    """A field at one distance and current on a grid of m heights and n radii, arrays of shape (m, n)."""

    distance_m: float
    current_A: float | tuple[float, ...]  # One each of several circuits
    radius_m: FloatArray
    height_m: FloatArray
    flux_density_T: FloatArray  # |B|
    flux_Wb: FloatArray  # 2 pi r A_phi, the flux through the circle of radius r, whose contours are the flux lines
    force_N: float
    # What the stress of the moving part's own field integrates to on this mesh, taken away from the force
    self_force_N: float
    part_flux_density_T: dict[str, float]  # The largest |B| of each part off its corners
    unknowns: int


def sample_field(
    actuator: Actuator, distance: float, current: float | tuple[float, ...], settings: SolverSettings | None = None
) -> FieldSample:
    """Solve at one point and sample the field."""
    return sample_of(solve_point(actuator, distance, current, settings))


def sample_of(point: SolvedPoint) -> FieldSample:
    """Sample a field that is solved."""
    from femfit.field.weak_form import flux_density

    radius, height = _window(point.actuator, point.distance_m)
    r, z = np.meshgrid(radius, height)
    points = point.mesh(r.ravel(), z.ravel())
    density = flux_density(point.w)(points)
    w = point.w(points).reshape(r.shape)
    magnitude = np.hypot(*density.T).reshape(r.shape)
    return FieldSample(
        distance_m=point.distance_m,
        current_A=point.current_A,
        radius_m=radius,
        height_m=height,
        flux_density_T=magnitude,
        flux_Wb=2.0 * np.pi * r**2 * w,
        force_N=point.force_N,
        self_force_N=point.self_force_N,
        part_flux_density_T=_largest(point.actuator, point.distance_m, r, z, magnitude),
        unknowns=point.unknowns,
    )


def _window(actuator: Actuator, distance: float) -> tuple[FloatArray, FloatArray]:
    corners = np.concatenate([standing_corners(actuator), moving_corners(actuator, distance)])
    size = float(corners[:, 0].max())
    right = (1.0 + MARGIN) * size
    low, high = corners[:, 1].min() - MARGIN * size, corners[:, 1].max() + MARGIN * size
    rows = int(np.ceil(COLUMNS * (high - low) / right))
    return np.linspace(0.0, right, COLUMNS), np.linspace(low, high, rows)


def _largest(
    actuator: Actuator, distance: float, r: FloatArray, z: FloatArray, magnitude: FloatArray
) -> dict[str, float]:
    def inside(region: Region, shift: float) -> FloatArray:
        return np.asarray(magnitude[shapely.contains_xy(polygon(region), r, z - shift)])

    largest = {r.name: inside(r, 0.0 if r in actuator.fixed else distance) for r in actuator.regions}
    return {name: float(np.percentile(values, CORNER_PERCENTILE)) for name, values in largest.items() if values.size}


TRIANGLE = 5  # VTK's number of the cell

SUBDIVISIONS = 6
"""Pieces of each side of an element; one more than the usual order of the field."""


@dataclass(frozen=True, eq=False)
class FieldCells:
    """A field at n points (r, z) of the half section, vectors of shape (n, 2), with the triangles between them."""

    points_m: FloatArray
    triangles: IntArray
    elements: IntArray  # Points at the corners of each finite element; shape (e, 3)
    # Names of the mesh's regions, as in femfit.field.layout; ``point_region`` and ``triangle_region`` are places in it
    regions: tuple[str, ...]
    point_region: IntArray
    triangle_region: IntArray
    potential_Wb_per_m: FloatArray  # A_phi; shape (n,)
    flux_density_T: FloatArray
    field_A_per_m: FloatArray
    # B / (mu_0 H) where a part saturates; the recoil permeability in magnets; shape (n,)
    relative_permeability: FloatArray


def field_cells(point: SolvedPoint, subdivisions: int = SUBDIVISIONS) -> FieldCells:
    """Evaluate a field on a lattice of points in each element."""
    import ngsolve as ng

    from femfit.field.weak_form import flux_density, materials

    lattice, pattern, corners = _lattice(subdivisions)
    rule = ng.IntegrationRule(points=lattice, weights=[0.0] * len(lattice))
    mapped = point.mesh.MapToAllElements(rule, ng.VOL)
    place = np.asarray(ng.CF((ng.x, ng.y))(mapped))
    density = np.asarray(flux_density(point.w)(mapped))
    names, index = np.unique(point.mesh.GetMaterials(), return_inverse=True)
    of_element = index[[element.index for element in point.mesh.Elements(ng.VOL)]]
    first = len(lattice) * np.arange(len(of_element))
    of_point = np.repeat(of_element, len(lattice))
    field, permeability = _respond(density, of_point, tuple(names), materials(point.actuator))
    return FieldCells(
        points_m=place,
        triangles=(first[:, None, None] + pattern).reshape(-1, 3),
        elements=first[:, None] + corners,
        regions=tuple(str(name) for name in names),
        point_region=of_point,
        triangle_region=np.repeat(of_element, len(pattern)),
        potential_Wb_per_m=place[:, 0] * np.asarray(point.w(mapped)).ravel(),
        flux_density_T=density,
        field_A_per_m=field,
        relative_permeability=permeability,
    )


def _lattice(n: int) -> tuple[list[tuple[float, float]], IntArray, IntArray]:
    """Points of the unit triangle, the small triangles between them, and the points at its corners."""
    place = {(j, k): 0 for k in range(n + 1) for j in range(n + 1 - k)}
    place = {key: number for number, key in enumerate(place)}
    up = [(place[j, k], place[j + 1, k], place[j, k + 1]) for j, k in place if j + k < n]
    down = [(place[j + 1, k], place[j + 1, k + 1], place[j, k + 1]) for j, k in place if j + k < n - 1]
    corners = np.array([place[0, 0], place[n, 0], place[0, n]])
    return [(j / n, k / n) for j, k in place], np.array(up + down), corners


def _respond(
    density: FloatArray, region: IntArray, names: tuple[str, ...], named: dict[str, Material]
) -> tuple[FloatArray, FloatArray]:
    """H of shape (n, 2) and mu_r of shape (n,)."""
    field, permeability = np.empty_like(density), np.empty(len(density))
    for number, name in enumerate(names):
        here = region == number
        material = named.get(name, AIR)
        b = density[here]
        if isinstance(material, LinearMaterial):
            field[here] = material.reluctivity * (b - material.remanence_T * np.array(material.direction))
            permeability[here] = material.relative_permeability
        else:
            curve = BHCurve(material.flux_density_T, material.field_A_per_m)
            reluctivity = curve.reluctivity(np.hypot(*b.T))
            field[here] = reluctivity[:, None] * b
            permeability[here] = 1.0 / (MU_0 * reluctivity)
    return field, permeability


def write_vtu(point: SolvedPoint, cells: FieldCells, path: Path) -> None:
    """Write the half section as an unstructured grid in the plane (r, z, 0), in m.

    Of points: ``A_phi`` (Wb/m), ``flux`` (2 pi r A_phi in Wb, whose contours are the flux lines), ``B`` (T, vector),
    ``B_magnitude``, ``H`` (A/m, vector), ``mu_r``. Of cells: ``region``, the place of its name in the field data
    ``regions``. Field data also: ``distance_m``, ``current_A``, ``force_N``.
    """
    import pyvista
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    def in_space(plane: np.ndarray) -> np.ndarray:
        return np.column_stack([plane, np.zeros(len(plane))])

    count = len(cells.triangles)
    corners = np.column_stack([np.full(count, 3), cells.triangles]).ravel()
    grid = pyvista.UnstructuredGrid(corners, np.full(count, TRIANGLE, dtype=np.uint8), in_space(cells.points_m))
    grid.point_data["A_phi"] = cells.potential_Wb_per_m
    grid.point_data["flux"] = 2.0 * np.pi * cells.points_m[:, 0] * cells.potential_Wb_per_m
    grid.point_data["B"] = in_space(cells.flux_density_T)
    grid.point_data["B_magnitude"] = np.hypot(*cells.flux_density_T.T)
    grid.point_data["H"] = in_space(cells.field_A_per_m)
    grid.point_data["mu_r"] = cells.relative_permeability
    grid.cell_data["region"] = cells.triangle_region
    grid.field_data["regions"] = list(cells.regions)
    for name, value in (("distance_m", point.distance_m), ("current_A", point.current_A), ("force_N", point.force_N)):
        grid.field_data[name] = np.atleast_1d(value)
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    # VTK does not say that a disk is full, and may crash on it: it writes to memory, and Python to the disk.
    writer.WriteToOutputStringOn()
    writer.Write()
    write_text(path, writer.GetOutputString())
