"""The thermal network of a drawing: each part is a node, and what conducts between them and to the surroundings.

Iron and magnets are as warm everywhere as in their middle, to which heat goes through half of their thickness (volume
over surface). Between a winding's middle and its faces are the stars of :mod:`femfit.heat.walls`.
"""

from dataclasses import dataclass
from itertools import product
from typing import cast

import numpy as np
import shapely

from femfit.core.errors import UsageError
from femfit.core.numerics import FloatArray
from femfit.core.text import amount
from femfit.device.outlines import flattened
from femfit.device.parts import Actuator, Coil, Region
from femfit.device.thermal import AIR_CONDUCTIVITY, Surroundings, thermal_of
from femfit.heat.walls import NOTHING, OPEN, Faces, WindingHeat, faces_of, stars, winding_heat

SIDES, OWN = 4, 6
"""Faces of a winding, and all nodes beside its mean: these and the centres of its stars."""


@dataclass(frozen=True, eq=False)
class HeatNetwork:
    """Parts with their conductances: first the windings, then the regions that are not air.

    Parameters
    ----------
    windings : tuple of WindingHeat
        Of the coils.
    capacities, volumes_m3 : arrays, shape (n,)
        The first in J/K.
    between : array, shape (n, n)
        Conductances between the parts in W/K, symmetric, with zeros on the diagonal. A winding's stand for its mean:
        where that is kept, a warmer face means a colder one opposite, so that one past a winding may be negative.
    outwards : array, shape (n,)
        The same to the surroundings.
    inside : array, shape (windings, n + 1)
        How far a winding's mean is warmer than the faces that its heat leaves by, as a sum over the temperatures of
        the parts and the surroundings.
    released : array, shape (n, n + 1)
        Heat in W that each part's own faces and the mounting give to the surroundings, as such a sum.
    """

    coils: tuple[Coil, ...]
    regions: tuple[Region, ...]
    windings: tuple[WindingHeat, ...]
    capacities: FloatArray
    volumes_m3: FloatArray
    between: FloatArray
    outwards: FloatArray
    inside: FloatArray
    released: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parts."""
        return (*(coil.name for coil in self.coils), *(region.name for region in self.regions))

    @property
    def laplacian(self) -> FloatArray:
        """Matrix L in W/K with the heat L T - outwards T_ambient that leaves each part."""
        return np.asarray(np.diag(self.between.sum(axis=1) + self.outwards) - self.between)


def heat_network(actuator: Actuator, distance: float) -> HeatNetwork:
    """Build the network of a drawing with the moving part at a distance in m."""
    around, coils = actuator.thermal, actuator.coils
    fixed, moving = (
        [region for region in some if region.material.name != "air"]
        for some in (actuator.fixed, actuator.moving.regions)
    )
    regions, moves = (*fixed, *moving), [*(coil.moves for coil in coils), *[False] * len(fixed), *[True] * len(moving)]
    if not np.isfinite(distance):
        raise UsageError(f"The distance must be a finite number; it is {distance:g} m. Give where the body is held.")
    outlines = [coil.vertices_m for coil in coils] + [flattened(region.vertices_m, region.bulges) for region in regions]
    sections = [
        shapely.Polygon([(r, z + distance * moving_part) for r, z in outline])
        for outline, moving_part in zip(outlines, moves, strict=True)
    ]
    _require_apart([*(coil.name for coil in coils), *(region.name for region in regions)], sections, moves, distance)
    volumes = np.array([2.0 * np.pi * section.centroid.x * section.area for section in sections])
    faces = faces_of(sections, 2.0 * AIR_CONDUCTIVITY / around.film_W_per_m2_K)
    windings = tuple(winding_heat(coil, around.insulation_W_per_m_K) for coil in coils)
    materials, n, count = [thermal_of(region.material) for region in regions], len(sections), len(coils)
    conductivities = np.array([cast("float", material.conductivity_W_per_m_K) for material in materials])
    surfaces = np.bincount(faces.part, faces.area, n)[count:]
    # From face to middle in m^2 K/W; a winding's is in its stars
    resistance = np.concatenate([np.zeros(count), volumes[count:] / surfaces / conductivities])
    joined = _outside(n, count, faces, resistance, around)
    leaving = joined[n + 1 :].sum(axis=1)
    for k, (coil, winding) in enumerate(zip(coils, windings, strict=True)):
        for axis, ways in enumerate(stars(coil, winding.conductivity_W_per_m_K)):
            ends = (_node(n, k, 2 * axis), _node(n, k, 2 * axis + 1), k)
            for end, way in zip(ends, ways, strict=True):
                _join(joined, _node(n, k, SIDES + axis), end, 1.0 / way)
    standing = [k for k in range(n) if not moves[k]]
    if standing:
        held = max(standing, key=lambda k: (k >= count, volumes[k]))
        _join(joined, held, n, around.mounting_W_per_K)
    reduced, inside, released = _reduced(joined, n, leaving)
    between = -reduced[:n, :n]
    np.fill_diagonal(between, 0.0)
    stored = [cast("float", material.heat_capacity_J_per_m3_K) for material in materials] * volumes[count:]
    capacities = np.array([*(winding.heat_capacity_J_per_K for winding in windings), *stored])
    return HeatNetwork(coils, regions, windings, capacities, volumes, between, -reduced[:n, n], inside, released)


def _require_apart(names: list[str], sections: list[shapely.Polygon], moves: list[bool], distance: float) -> None:
    """Refuse a distance at which moving parts stand in fixed ones."""
    shared = 1e-6 * min(section.area for section in sections)  # of parts that touch, by rounding
    moving, fixed = ([k for k, is_moving in enumerate(moves) if is_moving is which] for which in (True, False))
    for k, j in product(moving, fixed):
        if sections[k].intersection(sections[j]).area > shared:
            raise UsageError(
                f"The distance must keep parts apart; at {amount(distance, 'm', 3)} {names[k]} stands in {names[j]}. "
                "Give a larger one."
            )


def _outside(n: int, count: int, faces: Faces, resistance: FloatArray, around: Surroundings) -> FloatArray:
    """Conductances (N, N) by the faces, among n parts, the surroundings, and the own nodes of ``count`` windings."""
    joined = np.zeros((n + 1 + OWN * count,) * 2)
    for source, side, facing, area, gap in zip(
        faces.part, faces.side, faces.facing, faces.area, faces.gap, strict=True
    ):
        here = _node(n, source, side) if source < count else source
        if facing == OPEN:
            _join(joined, here, n, area / (1.0 / around.film_W_per_m2_K + resistance[source]))
        elif facing != NOTHING and not facing < count <= source:  # that pair is counted from the winding's faces
            joint = around.winding_joint_m if min(source, facing) < count else around.joint_m
            crossed = max(gap, joint) / AIR_CONDUCTIVITY + resistance[source] + resistance[facing]
            there = _node(n, facing, side ^ 1) if facing < count else facing
            both = (source < count) == (facing < count)  # counted from either side
            _join(joined, here, there, (0.5 if both else 1.0) * area / crossed)
    return joined


def _node(parts: int, winding: int, node: int) -> int:
    return parts + 1 + OWN * winding + node


def _join(conductances: FloatArray, first: int, second: int, conductance: float) -> None:
    conductances[first, second] += conductance
    conductances[second, first] += conductance


def _reduced(conductances: FloatArray, n: int, leaving: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The Laplacian of parts and surroundings, (n + 1, n + 1), ``inside`` and ``released`` of :class:`HeatNetwork`.

    Faces and stars, by which heat leaves with these conductances, store none and are eliminated.
    """
    full = np.diag(conductances.sum(axis=1)) - conductances
    retained, gone = slice(0, n + 1), slice(n + 1, None)
    follow = -np.linalg.solve(full[gone, gone], full[gone, retained])  # temperatures of faces and stars
    inside = np.zeros((len(leaving) // OWN, n + 1))
    for k, share in enumerate(leaving.reshape(-1, OWN)):
        if share.any():
            inside[k] = -(share / share.sum()) @ follow[OWN * k : OWN * (k + 1)]
            inside[k, k] += 1.0
    nodes = np.vstack([np.eye(n + 1), follow])  # temperatures of all, as sums over the parts and the surroundings
    released = np.zeros((n + 1, n + 1))
    owners = [*range(n + 1), *np.repeat(np.arange(len(inside)), OWN)]
    np.add.at(released, owners, conductances[n][:, None] * (nodes - nodes[n]))
    return full[retained, retained] + full[retained, gone] @ follow, inside, released[:n]
