"""Conduction in a drawing of boxes on a fine grid of (r, z): every cell is one volume, whatever part it is of.

Winding, iron and magnet conduct in full, and the air of narrow gaps and closed pockets conducts; where parts touch is
the joint's air. Nothing is lumped. Free faces have the film. What is open air is told by discs as wide as the widest
gap that come from far away.
"""

from itertools import pairwise

import numpy as np
import scipy.sparse as sp
import shapely
from scipy import ndimage
from scipy.sparse.linalg import spsolve

from femfit.device.parts import Coil
from femfit.device.thermal import AIR_CONDUCTIVITY, thermal_of
from femfit.heat.network import winding_heat

OUTSIDE, AIR = -2, -1
STEP = 0.5e-3
FEWEST = 8  # cells between two edges of the drawing


def rises(actuator, distance, heat_W):
    """Mean and largest temperature over ambient of coils, fixed and moving regions, by even heat in each coil in W."""
    around = actuator.thermal
    parts = [*actuator.coils, *actuator.fixed, *actuator.moving.regions]
    moving = [part in actuator.moving.regions or getattr(part, "moves", False) for part in parts]
    shapes = [
        shapely.Polygon([(r, z + distance * moves) for r, z in part.vertices_m])
        for part, moves in zip(parts, moving, strict=True)
    ]
    corners = np.concatenate([np.array(one.exterior.coords) for one in shapes])
    r, z = grid_lines([0.0, *corners[:, 0]]), grid_lines(corners[:, 1])
    middle = np.stack(np.meshgrid(*(0.5 * (one[1:] + one[:-1]) for one in (r, z)), indexing="ij"), axis=-1)
    owner = np.full(middle.shape[:2], AIR)
    for k, shape in enumerate(shapes):
        owner[shapely.contains_xy(shape, middle[..., 0], middle[..., 1])] = k
    owner[(owner == AIR) & open_air(shapes, middle, 2.0 * AIR_CONDUCTIVITY / around.film_W_per_m2_K)] = OUTSIDE
    known = np.array([*(conductivity(part, around) for part in parts), 0.0, AIR_CONDUCTIVITY])  # the last by -2 and -1
    volume = np.pi * np.diff(r**2)[:, None] * np.diff(z)
    own = [owner == k for k in range(len(parts))]
    heat = sum(watts * (volume * cells) / (volume * cells).sum() for watts, cells in zip(heat_W, own, strict=False))
    field = solved(owner, known[owner], r, z, heat, around, len(heat_W))
    return [(float((field * volume)[cells].sum() / volume[cells].sum()), float(field[cells].max())) for cells in own]


def conductivity(part, around):
    if isinstance(part, Coil):
        return winding_heat(part, around.insulation_W_per_m_K).conductivity_W_per_m_K
    return thermal_of(part.material).conductivity_W_per_m_K


def grid_lines(coordinates):
    edges = np.unique(np.round(coordinates, 9))
    pieces = [np.linspace(a, b, max(FEWEST, int(np.ceil((b - a) / STEP))) + 1)[:-1] for a, b in pairwise(edges)]
    return np.append(np.concatenate(pieces), edges[-1])


def open_air(shapes, middle, widest):
    """Which places a disc of that diameter covers that comes from far away and touches no part."""
    pixel, margin = widest / 54.0, 2.0 * widest
    high, low = middle[-1, -1] + margin, middle[0, 0, 1] - margin
    axes = np.arange(-high[0], high[0], pixel), np.arange(low, high[1], pixel)
    across, along = np.meshgrid(*axes, indexing="ij")
    solid = np.any([shapely.contains_xy(shape, np.abs(across), along) for shape in shapes], axis=0)
    centres = (ndimage.distance_transform_edt(~solid) - 0.5) * pixel >= 0.5 * widest
    labels, _ = ndimage.label(centres)
    covered = (ndimage.distance_transform_edt(labels != labels[0, 0]) - 0.5) * pixel < 0.5 * widest
    at = [np.clip(np.searchsorted(axis, middle[..., k]), 0, len(axis) - 1) for k, axis in enumerate(axes)]
    return covered[at[0], at[1]]


def solved(owner, known, r, z, heat, around, windings):
    """Temperatures over ambient of all cells."""
    number = np.where(owner == OUTSIDE, -1, np.cumsum(owner != OUTSIDE).reshape(owner.shape) - 1)
    dz, mid = np.diff(z), 0.5 * (r[1:] + r[:-1])
    loss, entries = np.zeros(number.max() + 1), []
    # Along r, then along z: faces between cells, and the way from each cell's middle to its lower and its upper face
    inner = r[:-1] * np.log(mid / np.maximum(r[:-1], 1e-12))
    radial = 2.0 * np.pi * r[:, None] * dz, inner[:, None], (r[1:] * np.log(r[1:] / mid))[:, None]
    axial = np.pi * np.diff(r**2)[:, None] * np.ones(len(z)), 0.5 * dz, 0.5 * dz
    film, size = 1.0 / around.film_W_per_m2_K, owner.shape
    for axis, (area, down, up) in enumerate((radial, axial)):
        low, high = (np.take(area, range(a, b), axis) for a, b in ((0, size[axis]), (1, size[axis] + 1)))
        with np.errstate(divide="ignore", invalid="ignore"):
            ways = np.broadcast_to(down, size) / known, np.broadcast_to(up, size) / known
        first, last = range(size[axis] - 1), range(1, size[axis])
        one, other = np.take(owner, first, axis), np.take(owner, last, axis)
        joint = np.where(np.minimum(one, other) < windings, around.winding_joint_m, around.joint_m) / AIR_CONDUCTIVITY
        joint = np.where((one >= 0) & (other >= 0) & (one != other), joint, 0.0)
        both = (one != OUTSIDE) & (other != OUTSIDE)
        way = np.take(ways[1], first, axis) + joint + np.take(ways[0], last, axis)
        g = np.take(high, first, axis)[both] / way[both]
        a, b = np.take(number, first, axis)[both], np.take(number, last, axis)[both]
        entries += [(a, a, g), (b, b, g), (a, b, -g), (b, a, -g)]
        beyond = np.pad(owner, [(1, 1) if k == axis else (0, 0) for k in (0, 1)], constant_values=OUTSIDE)
        if axis == 0:
            beyond[0] = AIR  # nothing crosses the axis
        for face, path, start in ((low, ways[0], 0), (high, ways[1], 2)):
            free = (owner >= 0) & (np.take(beyond, range(start, start + size[axis]), axis) == OUTSIDE)
            np.add.at(loss, number[free], face[free] / (path[free] + film))
    rows, columns, values = (np.concatenate(one) for one in zip(*entries, strict=True))
    matrix = sp.coo_matrix((values, (rows, columns)), shape=(len(loss),) * 2).tocsc() + sp.diags(loss, format="csc")
    inside = owner != OUTSIDE
    rise = spsolve(matrix, heat[inside])
    assert np.isclose(loss @ rise, heat.sum(), rtol=1e-8)
    return np.where(inside, rise[number], 0.0)
