"""One point solved for its pictures, and its field on a regular grid of the half section."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator, Region
from femfit.field.outline import polygon
from femfit.field.settings import SolverSettings, settings_for
from femfit.report.parts import all_regions, moving_corners, standing_corners

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

    found = {r.name: inside(r, 0.0 if r in actuator.fixed else distance) for r in all_regions(actuator)}
    return {name: float(np.percentile(values, CORNER_PERCENTILE)) for name, values in found.items() if values.size}
