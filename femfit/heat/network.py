"""The thermal network of a drawing: each part is a node, and what conducts between them and to the surroundings.

Iron and magnets are as warm everywhere as in their middle, to which heat goes through half of their thickness (volume
over surface). Between a winding's middle and its faces are the stars of :mod:`femfit.heat.winding`.
"""

from dataclasses import dataclass
from typing import cast

import numpy as np
import shapely

from femfit.core.arrays import FloatArray
from femfit.device.outlines import flattened
from femfit.device.parts import Actuator, Coil, Region
from femfit.device.thermal import AIR_CONDUCTIVITY, Surroundings, ThermalMaterial, thermal_of
from femfit.heat.walls import NOTHING, OPEN, Faces, faces_of
from femfit.heat.winding import WindingHeat, stars, winding_heat

SIDES = 4


@dataclass(frozen=True, eq=False)
class HeatNetwork:
    """Parts with their conductances; windings come first.

    Parameters
    ----------
    parts : tuple of Coil and Region
        The nodes; regions of air are none.
    windings : tuple of WindingHeat
        Of the first nodes.
    capacities, volumes_m3 : arrays, shape (n,)
        The first in J/K.
    between : array, shape (n, n)
        Conductances between the parts in W/K, symmetric, with zeros on the diagonal.
    outwards : array, shape (n,)
        Conductances to the surroundings in W/K.
    inside : array, shape (windings, n + 1)
        How far a winding's mean is warmer than the faces that its heat leaves by, as a sum over the temperatures of
        the parts and the surroundings.
    """

    parts: tuple[Coil | Region, ...]
    windings: tuple[WindingHeat, ...]
    capacities: FloatArray
    volumes_m3: FloatArray
    between: FloatArray
    outwards: FloatArray
    inside: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parts."""
        return tuple(part.name for part in self.parts)

    @property
    def laplacian(self) -> FloatArray:
        """Matrix L in W/K with the heat L T - outwards T_ambient that leaves each part."""
        return np.asarray(np.diag(self.between.sum(axis=1) + self.outwards) - self.between)


def heat_network(actuator: Actuator, distance: float) -> HeatNetwork:
    """Build the network of a drawing with the moving part at a distance in m."""
    surroundings = actuator.thermal
    fixed, moving = actuator.fixed, actuator.moving.regions
    drawn: list[tuple[Coil | Region, bool]] = [(coil, coil.moves) for coil in actuator.coils]
    drawn += [(one, at is moving) for at in (fixed, moving) for one in at if one.material.name != "air"]
    parts = tuple(part for part, _ in drawn)
    sections = [_section(part, distance if moves else 0.0) for part, moves in drawn]
    faces = faces_of(sections, 2.0 * AIR_CONDUCTIVITY / surroundings.film_W_per_m2_K)
    windings = tuple(winding_heat(coil, surroundings.insulation_W_per_m_K) for coil in actuator.coils)
    whole = _assembled(parts, sections, faces, windings, surroundings)
    standing = [k for k, (_, moves) in enumerate(drawn) if not moves]
    if standing:
        held = max(standing, key=lambda k: (k >= len(windings), _volume(sections[k])))
        _join(whole, held, len(parts), surroundings.mounting_W_per_K)
    return _reduced(parts, windings, sections, whole)


def _section(part: Coil | Region, shift: float) -> shapely.Polygon:
    corners = flattened(part.vertices_m, part.bulges if isinstance(part, Region) else ())
    return shapely.Polygon([(r, z + shift) for r, z in corners])


def _material(part: Coil | Region) -> ThermalMaterial:
    return thermal_of(cast("Region", part).material)


def _volume(section: shapely.Polygon) -> float:
    return float(2.0 * np.pi * section.centroid.x * section.area)


def _assembled(
    parts: tuple[Coil | Region, ...],
    sections: list[shapely.Polygon],
    faces: Faces,
    windings: tuple[WindingHeat, ...],
    surroundings: Surroundings,
) -> FloatArray:
    """Conductances (N, N) among parts, surroundings, and of each winding its faces and the centres of its stars."""
    n, count = len(parts), len(windings)
    whole = np.zeros((n + 1 + (SIDES + 2) * count,) * 2)
    resistance = np.zeros(n)  # From face to middle in m^2 K/W; a winding's is in its stars
    for k in range(count, n):
        half = _volume(sections[k]) / np.sum(faces.area[faces.part == k])
        resistance[k] = half / cast("float", _material(parts[k]).conductivity_W_per_m_K)
    for one, side, other, area, gap in zip(faces.part, faces.side, faces.facing, faces.area, faces.gap, strict=True):
        here = _node(n, one, side) if one < count else one
        if other == OPEN:
            _join(whole, here, n, area / (1.0 / surroundings.film_W_per_m2_K + resistance[one]))
        elif other != NOTHING:
            joint = surroundings.winding_joint_m if min(one, other) < count else surroundings.joint_m
            crossed = max(gap, joint) / AIR_CONDUCTIVITY + resistance[one] + resistance[other]
            if other < count <= one:
                continue  # counted from the winding, whose faces are told apart
            there = _node(n, other, side ^ 1) if other < count else other
            both = (one < count) == (other < count)  # counted from either side
            _join(whole, here, there, (0.5 if both else 1.0) * area / crossed)
    for k, winding in enumerate(windings):
        for axis, ways in enumerate(stars(cast("Coil", parts[k]), winding.conductivity_W_per_m_K)):
            centre = n + 1 + (SIDES + 2) * k + SIDES + axis
            ends = (_node(n, k, 2 * axis), _node(n, k, 2 * axis + 1), k)
            for end, way in zip(ends, ways, strict=True):
                _join(whole, centre, end, 1.0 / way)
    return whole


def _node(parts: int, winding: int, side: int) -> int:
    return parts + 1 + (SIDES + 2) * winding + side


def _join(whole: FloatArray, one: int, other: int, conductance: float) -> None:
    whole[one, other] += conductance
    whole[other, one] += conductance


def _reduced(
    parts: tuple[Coil | Region, ...],
    windings: tuple[WindingHeat, ...],
    sections: list[shapely.Polygon],
    whole: FloatArray,
) -> HeatNetwork:
    """Eliminate the faces and the stars, which store no heat."""
    n, count = len(parts), len(windings)
    full = np.diag(whole.sum(axis=1)) - whole
    kept, gone = slice(0, n + 1), slice(n + 1, None)
    follow = -np.linalg.solve(full[gone, gone], full[gone, kept])  # temperatures of faces and stars
    left = full[kept, kept] + full[kept, gone] @ follow
    between = -left[:n, :n]
    np.fill_diagonal(between, 0.0)
    capacities = [one.heat_capacity_J_per_K for one in windings]
    for part, section in zip(parts[count:], sections[count:], strict=True):
        each = cast("float", _material(part).heat_capacity_J_per_m3_K)
        capacities.append(each * _volume(section))
    inside = np.zeros((count, n + 1))
    for k in range(count):
        start = (SIDES + 2) * k
        faces = slice(start, start + SIDES)
        leaving = whole[n + 1 + start : n + 1 + start + SIDES].copy()
        leaving[:, n + 1 + start + SIDES : n + 1 + start + SIDES + 2] = 0.0  # the ways inside
        share = leaving.sum(axis=1)
        inside[k] = -(share / share.sum()) @ follow[faces] if share.sum() else 0.0
        inside[k, k] += float(share.sum() > 0.0)
    volumes = np.array([_volume(one) for one in sections])
    return HeatNetwork(parts, windings, np.array(capacities), volumes, between, -left[:n, n], inside)
