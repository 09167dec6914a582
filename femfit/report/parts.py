"""The parts of an actuator as all pictures show them: kind, colour, outline of the full section."""

import numpy as np
import shapely

from femfit.core.numerics import FloatArray
from femfit.device.parts import Actuator, Material, is_iron
from femfit.field.layout import fixed_parts, moving_parts, part_corners

Outline = tuple[tuple[float, float], ...]

COLOURS = {
    "iron, fixed": "#8c96a1",
    "iron, moving": "#5b6f86",
    "magnet": "#b0477d",
    "winding": "#e0a341",
    "not magnetic": "#dfe3e7",
}
"""Distinct in lightness as well as in hue."""

HALL_COLOUR = "#009e73"


def kind_of(material: Material, moving: bool) -> str:
    """The kind of a region."""
    if material.remanence_T:
        return "magnet"
    if is_iron(material):
        return "iron, moving" if moving else "iron, fixed"
    return "not magnetic"


def half_sections(actuator: Actuator, distance: float) -> list[tuple[Outline, float, str]]:
    """Corners, shift along z and kind of each part: fixed ones, windings, moving ones."""
    parts = [(part_corners(r), 0.0, kind_of(r.material, moving=False)) for r in actuator.fixed]
    parts += [(coil.vertices_m, distance if coil.moves else 0.0, "winding") for coil in actuator.coils]
    return parts + [(part_corners(r), distance, kind_of(r.material, moving=True)) for r in actuator.moving.regions]


def full_section(vertices: Outline, shift: float = 0.0) -> tuple[FloatArray, ...]:
    """Corners (x, z) of a part in the full section: one outline on the axis, a left and a right one of a ring."""
    half = np.asarray(vertices, dtype=np.float64) + np.array([0.0, shift])
    both = shapely.union_all([shapely.Polygon(half), shapely.Polygon(half * np.array([-1.0, 1.0]))])
    parts = getattr(both, "geoms", [both])
    return tuple(np.asarray(part.exterior.coords)[:-1] for part in sorted(parts, key=lambda p: float(p.centroid.x)))


def mirrored(radius: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A quantity that is even in r, shape (m, n), on the full section."""
    return np.concatenate([-radius[:0:-1], radius]), np.concatenate([values[:, :0:-1], values], axis=1)


def standing_corners(actuator: Actuator) -> FloatArray:
    """Corners (r, z) of what stands still in m, shape (n, 2)."""
    return np.concatenate([np.asarray(part_corners(fixed_part)) for fixed_part in fixed_parts(actuator)])


def moving_corners(actuator: Actuator, distance: float) -> FloatArray:
    """Corners (r, z) of the moving part at a distance in m, shape (n, 2)."""
    drawn = np.concatenate([np.asarray(part_corners(moving_part)) for moving_part in moving_parts(actuator)])
    return np.asarray(drawn + np.array([0.0, distance]))
