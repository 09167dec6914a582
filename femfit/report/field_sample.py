"""A solved point: its field on a regular grid of the half section for pictures, and as a file for ParaView."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import shapely

from femfit.core.files import replacing
from femfit.core.numerics import MU_0, FloatArray
from femfit.device.materials import BHCurve
from femfit.device.parts import Actuator, LinearMaterial, Material
from femfit.field.layout import polygon
from femfit.field.tolerance import SolverSettings, settings_for
from femfit.report.drawing import corners_of, drawn_parts

COLUMNS = 260
"""Points along the radius; a picture of 2 x 260 columns shows no steps at the page's width."""

MARGIN = 0.55
"""Air around the parts, as a part of the electromagnet's radius."""

CORNER_PERCENTILE = 98.0
"""Fields are singular at corners: the largest |B| of a part is that without its highest 2 % of points."""


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
    part_flux_density_T: dict[str, float]  # The largest |B| of each part off its corners
    unknowns: int


@dataclass(frozen=True, eq=False)
class SolvedPoint:
    """A solution, A_phi = r w in T m, with its mesh, made at this very distance so that it is not stretched."""

    actuator: Actuator
    distance_m: float
    current_A: float | tuple[float, ...]
    mesh: Any
    w: Any
    force_N: float
    unknowns: int

    @cached_property
    def sample(self) -> FieldSample:
        """The field on a grid, for pictures."""
        from femfit.field.weak_form import flux_density

        actuator, distance = self.actuator, self.distance_m
        radius, height = _window(actuator, distance)
        r, z = np.meshgrid(radius, height)
        points = self.mesh(r.ravel(), z.ravel())
        magnitude = np.hypot(*flux_density(self.w)(points).T).reshape(r.shape)
        largest = {}
        for region in actuator.regions:
            heights = z if region in actuator.fixed else z - distance
            inside = magnitude[shapely.contains_xy(polygon(region), r, heights)]
            if inside.size:
                largest[region.name] = float(np.percentile(inside, CORNER_PERCENTILE))
        flux, force = 2.0 * np.pi * r**2 * self.w(points).reshape(r.shape), self.force_N
        return FieldSample(distance, self.current_A, radius, height, magnitude, flux, force, largest, self.unknowns)


def solve_point(
    actuator: Actuator, distance: float, current: float | tuple[float, ...], settings: SolverSettings | None = None
) -> SolvedPoint:
    """Solve at one point."""
    from femfit.field.layout import layout_of
    from femfit.field.problem import prepare

    settings = settings or settings_for(actuator)
    asked = np.atleast_2d(current)
    problem = prepare(actuator, (distance,), layout_of(actuator, settings), settings, currents=asked)
    w, force = problem.field(distance, current)
    return SolvedPoint(actuator, distance, current, problem.mesh, w, force, problem.unknowns)


def _window(actuator: Actuator, distance: float) -> tuple[FloatArray, FloatArray]:
    corners = corners_of(drawn_parts(actuator, distance))
    size = float(corners[:, 0].max())
    right = (1.0 + MARGIN) * size
    low, high = corners[:, 1].min() - MARGIN * size, corners[:, 1].max() + MARGIN * size
    rows = int(np.ceil(COLUMNS * (high - low) / right))
    return np.linspace(0.0, right, COLUMNS), np.linspace(low, high, rows)


SUBDIVISIONS = 2
"""How often each side of an element is halved in the file, within which the field is of order 5."""

LARGEST_T, CURVE_STEP_T = 6.0, 1e-3
"""Range and step of the curves in the file, between which mu_r is within 0.1 %."""


def write_vtu(point: SolvedPoint, path: Path) -> None:
    """Write the half section as an unstructured grid in the plane (r, z, 0), in m.

    Of points: ``A_phi`` (Wb/m), ``flux`` (2 pi r A_phi in Wb, whose contours are the flux lines), ``B`` (T, vector),
    ``H`` (A/m, vector), ``mu_r``, and ``region``: 0 in air and windings, then the parts as drawn, fixed ones first.
    Neighbouring elements share no point, so that what jumps between parts (B along a face, H across it, mu_r) does.
    """
    import ngsolve as ng

    from femfit.field.weak_form import flux_density, materials

    named, mesh, b = materials(point.actuator), point.mesh, flux_density(point.w)
    reluctivity = mesh.MaterialCF({k: _reluctivity(m, ng.Norm(b)) for k, m in named.items()}, default=1.0 / MU_0)
    remanence = {
        name: ng.CF(tuple(material.remanence_T * np.array(material.direction)))
        for name, material in named.items()
        if isinstance(material, LinearMaterial)
    }
    h = reluctivity * (b - mesh.MaterialCF(remanence, default=ng.CF((0.0, 0.0))))
    fields = {
        "A_phi": ng.x * point.w,
        "flux": 2.0 * np.pi * ng.x**2 * point.w,
        "B": ng.CF((b[0], b[1], 0.0)),
        "H": ng.CF((h[0], h[1], 0.0)),
        "mu_r": 1.0 / (MU_0 * reluctivity),
        "region": mesh.MaterialCF({name: k for k, name in enumerate(named, 1)}, default=0),
    }
    with TemporaryDirectory() as directory:  # NGSolve does not say that a disk is full
        file = Path(directory) / "field"
        ng.VTKOutput(mesh, list(fields.values()), list(fields), str(file), subdivision=SUBDIVISIONS).Do()
        with replacing(path) as unfinished:
            copyfile(file.with_suffix(".vtu"), unfinished)


def _reluctivity(material: Material, magnitude: Any) -> Any:
    """Nu in m/H of a material at |B|, a coefficient of NGSolve."""
    import ngsolve as ng

    if isinstance(material, LinearMaterial):
        return material.reluctivity
    b = np.arange(0.0, LARGEST_T, CURVE_STEP_T)
    values = BHCurve(material.flux_density_T, material.field_A_per_m).reluctivity(b)
    return ng.BSpline(2, [0.0, *b.tolist()], values.tolist())(magnitude)
