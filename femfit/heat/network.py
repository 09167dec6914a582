"""The thermal network of a drawing: each part is a node, and what conducts between them and to the surroundings.

Iron and magnets are as warm everywhere as in their middle, to which heat goes through half of their thickness (volume
over surface). Between a winding's middle and its faces are the stars of :mod:`femfit.heat.network`.

Ways of heat out of a part: through a winding to its faces, and from faces to other parts or the open air.

A ray leaves each piece of an outline along its normal. Where it meets another part, heat crosses what is between them:
of a tube of rays over the length g from the radius r to r', 2 pi ds (r' - r) / ln(r' / r) / g of air, which is exact
for flat and for cylindrical layers. The open air is where a disc as wide as the gap gets to that conducts as well as
the air's two films; a wider pocket that is closed counts as such a gap.

A winding counts as a ring of rectangular section with the same heat everywhere. Its faces and its mean temperature are
then joined by two stars, one for each direction, which are exact where heat leaves in that direction alone; where it
leaves in both, the rise inside is up to a fifth too large.

References
----------
P. H. Mellor, D. Roberts and D. R. Turner, IEE Proceedings B 138 (1991) 205: the stars of a ring.
N. Simpson, R. Wrobel and P. H. Mellor, IEEE Trans. Industry Applications 49 (2013) 2505: round wires in a filler.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import shapely
from numpy.typing import NDArray

from femfit.core.errors import UsageError
from femfit.core.numerics import COPPER_RESISTIVITY_20C, FloatArray, IntArray
from femfit.core.text import amount
from femfit.device.outlines import flattened
from femfit.device.parts import Actuator, Coil, Region, copper_growth
from femfit.device.thermal import AIR_CONDUCTIVITY, LORENZ_NUMBER, METAL_CAPACITY, ROOM_K, Surroundings, thermal_of

PIECES = 400
"""Numerical: of each part's outline; conductances of the drawings of ``geometry/`` are within 0.5 % of 1,600."""

BESIDE = 2e-5
"""Numerical: in m, beside a face; wider than the chords of a closed outline are off its arcs."""

START = 1e-7
"""Numerical: in m, before a face; where a ray starts."""

OPEN, NOTHING = -1, -2
"""In place of the part that a piece faces: the open air, or nothing but its own part."""


@dataclass(frozen=True, eq=False)
class Faces:
    """Pieces of the outlines of parts, arrays of shape (pieces,)."""

    owner: IntArray  # Which part's
    side: IntArray  # Where it looks to: 0 inwards, 1 outwards, 2 down, 3 up
    facing: IntArray  # Which part it faces, or OPEN or NOTHING
    area: FloatArray  # In m^2; of a gap the mean along it
    gap: FloatArray  # In m; zero where parts touch, and of the open air


def faces_of(parts: Sequence[shapely.Polygon], widest: float) -> Faces:
    """Pieces of the outlines of sections (r, z); gaps wider than ``widest`` in m count as that wide."""
    pieces = [_pieces(section) for section in parts]
    which = np.repeat(np.arange(len(parts)), [len(piece[0]) for piece in pieces])
    place, normal, length = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    revolved = [
        shapely.union(section, shapely.transform(section, lambda points: points * [-1.0, 1.0])) for section in parts
    ]
    # With gaps narrower than the widest, and with all that these close in
    closed = shapely.union_all(revolved).buffer(0.5 * widest).buffer(-0.5 * widest)
    rings = [piece.exterior for piece in getattr(closed, "geoms", [closed])]
    filled = shapely.union_all([shapely.Polygon(ring) for ring in rings])
    free = ~shapely.contains_xy(filled, *(place + BESIDE * normal).T)
    low_r, low_z, high_r, high_z = filled.bounds
    start, stop = place + START * normal, place + np.hypot(high_r - low_r, high_z - low_z) * normal
    rays = shapely.linestrings(np.stack([start, stop], axis=1))
    origins = shapely.points(start)
    gaps = np.array([_distance(origins, rays, section) for section in revolved])
    nearest = gaps.argmin(axis=0)
    gap = gaps.min(axis=0) + START
    gap[gap < 10.0 * START] = 0.0
    met = np.isfinite(gap)
    facing = np.where(free | ~met, OPEN, np.where(nearest == which, NOTHING, nearest))
    gap = np.where(facing >= 0, np.minimum(gap, widest), 0.0)
    # The mean radius along a gap is logarithmic; a floor keeps rays that reach the axis finite
    near, far = (np.maximum(r, BESIDE) for r in (place[:, 0], np.abs(place[:, 0] + gap * normal[:, 0])))
    alike = np.abs(far - near) < 1e-6 * near
    ratio = np.where(alike, np.e, far / near)
    radius = np.where(alike, 0.5 * (near + far), (far - near) / np.log(ratio))
    side = np.where(np.abs(normal[:, 0]) > np.abs(normal[:, 1]), normal[:, 0] > 0.0, 2 + (normal[:, 1] > 0.0))
    return Faces(which, side.astype(np.int64), facing, 2.0 * np.pi * length * radius, gap)


def _pieces(section: shapely.Polygon) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Middles (n, 2), outward normals (n, 2) and lengths (n,) of an outline's pieces that are not on the axis."""
    ring = shapely.segmentize(section.exterior, section.exterior.length / PIECES)
    corners = np.array(ring.coords if ring.is_ccw else ring.coords[::-1])
    step = np.diff(corners, axis=0)
    length = np.hypot(*step.T)
    place = 0.5 * (corners[:-1] + corners[1:])
    outside = (length > 0.0) & (place[:, 0] > BESIDE)
    normal = np.column_stack([step[:, 1], -step[:, 0]])[outside] / length[outside, None]
    return place[outside], normal, length[outside]


def _distance(origins: NDArray[np.object_], rays: NDArray[np.object_], section: shapely.Geometry) -> FloatArray:
    """How far away along each ray a part is; infinite where it is not met."""
    distances = np.full(len(rays), np.inf)
    shapely.prepare(section)
    meets = shapely.intersects(section, rays)
    distances[meets] = shapely.distance(origins[meets], shapely.intersection(rays[meets], section))
    return distances


FILLER_CAPACITY = 1e6
"""Assumed: in J/(m^3 K), of enamel (2e6) and air between strands."""

DENSEST = math.pi / math.sqrt(12.0)
"""The largest share that round wires fill."""


@dataclass(frozen=True)
class WindingHeat:
    """What a winding's wire makes of its section."""

    conductivity_W_per_m_K: float  # Across the strands
    heat_capacity_J_per_K: float
    cold_ohm: float  # Resistance at 20 degC


def winding_heat(coil: Coil, insulation: float) -> WindingHeat:
    """Follow a winding from its wire, or from its resistance where the wire is not known.

    With a share f of copper, k = k_i ((1 + f) k_c + (1 - f) k_i) / ((1 - f) k_c + (1 + f) k_i).
    """
    section = shapely.Polygon(coil.vertices_m)
    turn, cold = 2.0 * math.pi * section.centroid.x, float(coil.resistance_ohm / copper_growth(coil.temperature_C))
    wire = 0.25 * math.pi * coil.wire_diameter_m**2 if coil.wire_diameter_m is not None else None
    copper = coil.turns * (wire or COPPER_RESISTIVITY_20C * coil.turns * turn / cold)
    share = min(copper / section.area, DENSEST)
    metal = LORENZ_NUMBER * ROOM_K / COPPER_RESISTIVITY_20C
    across = insulation * ((1.0 + share) * metal + (1.0 - share) * insulation)
    across /= (1.0 - share) * metal + (1.0 + share) * insulation
    capacity = (share * METAL_CAPACITY + (1.0 - share) * FILLER_CAPACITY) * section.area * turn
    return WindingHeat(across, capacity, cold)


def stars(coil: Coil, conductivity: float) -> FloatArray:
    """Resistances in K/W, rows (to the lower face, to the upper, to the mean) of the radial and the axial star."""
    inner, low, outer, high = shapely.Polygon(coil.vertices_m).bounds
    height, square, ratio = high - low, outer**2 - inner**2, math.log(outer / inner)
    unit = 1.0 / (4.0 * math.pi * conductivity * height)
    bent = 2.0 * ratio / square
    radial = (
        unit * (outer**2 * bent - 1.0),
        unit * (1.0 - inner**2 * bent),
        -0.5 * unit * (outer**2 + inner**2 - 2.0 * outer**2 * inner**2 * bent) / square,
    )
    along = height / (2.0 * math.pi * conductivity * square)
    return np.array([radial, (along, along, -along / 3.0)])


SIDES, OWN = 4, 6
"""Faces of a winding, and all nodes beside its mean: these and the centres of its stars."""


@dataclass(frozen=True, eq=False)
class HeatNetwork:
    """Parts with their conductances: first the windings, then the regions that are not air.

    Parameters
    ----------
    windings : tuple of WindingHeat
        Of the coils.
    capacities : array, shape (n,)
        In J/K.
    between : array, shape (n, n)
        Conductances between the parts in W/K, symmetric, with zeros on the diagonal. A winding's stand for its mean:
        where that is kept, a warmer face means a colder one opposite, so that one past a winding may be negative.
    outwards : array, shape (n,)
        The same to the surroundings.
    inside : array, shape (windings, n + 1)
        How far a winding's mean is warmer than the faces that its heat leaves by, as a sum over the temperatures of
        the parts and the surroundings.
    """

    coils: tuple[Coil, ...]
    regions: tuple[Region, ...]
    windings: tuple[WindingHeat, ...]
    capacities: FloatArray
    between: FloatArray
    outwards: FloatArray
    inside: FloatArray

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
    regions = tuple(region for region in actuator.regions if region.material.name != "air")
    moves = [*(coil.moves for coil in coils), *(region in actuator.moving.regions for region in regions)]
    if not np.isfinite(distance):
        raise UsageError(f"The distance must be a finite number; it is {distance:g} m. Give where the body is held.")
    outlines = [coil.vertices_m for coil in coils] + [flattened(region.vertices_m, region.bulges) for region in regions]
    sections = [
        shapely.Polygon([(r, z + distance * moving_part) for r, z in outline])
        for outline, moving_part in zip(outlines, moves, strict=True)
    ]
    areas = [section.area for section in sections]
    if sum(areas) - shapely.union_all(sections).area > 1e-6 * min(areas):  # of parts that touch, by rounding
        raise UsageError(f"The distance must keep parts apart; {amount(distance, 'm', 3)} does not. Give a larger one.")
    volumes = np.array([2.0 * np.pi * section.centroid.x * section.area for section in sections])
    faces = faces_of(sections, 2.0 * AIR_CONDUCTIVITY / around.film_W_per_m2_K)
    windings = tuple(winding_heat(coil, around.insulation_W_per_m_K) for coil in coils)
    materials, n, count = [thermal_of(region.material) for region in regions], len(sections), len(coils)
    conductivities = np.array([cast("float", material.conductivity_W_per_m_K) for material in materials])
    surfaces = np.bincount(faces.owner, faces.area, n)[count:]
    # From face to middle in m^2 K/W; a winding's is in its stars
    resistance = np.concatenate([np.zeros(count), volumes[count:] / surfaces / conductivities])
    joined = _outside(count, faces, resistance, around)
    leaving = joined[n + 1 :].sum(axis=1)
    inside_parts = np.zeros_like(joined)
    for k, (coil, winding) in enumerate(zip(coils, windings, strict=True)):
        first = n + 1 + OWN * k
        for axis, ways in enumerate(stars(coil, winding.conductivity_W_per_m_K)):
            inside_parts[first + SIDES + axis, [first + 2 * axis, first + 2 * axis + 1, k]] = 1.0 / ways
    if standing := [k for k in range(n) if not moves[k]]:
        inside_parts[max(standing, key=lambda k: (k >= count, volumes[k])), n] = around.mounting_W_per_K
    reduced, inside = _reduced(joined + inside_parts + inside_parts.T, n, leaving)
    between = -reduced[:n, :n]
    np.fill_diagonal(between, 0.0)
    stored = [cast("float", material.heat_capacity_J_per_m3_K) for material in materials] * volumes[count:]
    capacities = np.array([*(winding.heat_capacity_J_per_K for winding in windings), *stored])
    return HeatNetwork(coils, regions, windings, capacities, between, -reduced[:n, n], inside)


def _outside(count: int, faces: Faces, resistance: FloatArray, around: Surroundings) -> FloatArray:
    """Conductances (N, N) by the faces, among n parts, the surroundings, and the own nodes of ``count`` windings.

    ``resistance`` goes from each part's face to its middle, shape (n,), in m^2 K/W.
    """
    n, source, facing = len(resistance), faces.owner, faces.facing
    joined = np.zeros((n + 1 + OWN * count,) * 2)

    def nodes(parts: IntArray, sides: IntArray) -> IntArray:
        return np.where(parts < count, n + 1 + OWN * parts + sides, parts)

    inner_node, outer_node = nodes(source, faces.side), nodes(facing, faces.side ^ 1)
    free = facing == OPEN
    film = faces.area / (1.0 / around.film_W_per_m2_K + resistance[source])
    np.add.at(joined, (inner_node[free], n), film[free])
    joint = np.where(np.minimum(source, facing) < count, around.winding_joint_m, around.joint_m)
    crossed = np.maximum(faces.gap, joint) / AIR_CONDUCTIVITY + resistance[source] + resistance[facing]
    # Of a winding and another part the winding's faces count, of others those of both sides
    alike = (source < count) == (facing < count)
    met = (facing >= 0) & (alike | (source < count))
    np.add.at(joined, (inner_node[met], outer_node[met]), (np.where(alike, 0.5, 1.0) * faces.area / crossed)[met])
    return joined + joined.T


def _reduced(conductances: FloatArray, n: int, leaving: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The Laplacian of parts and surroundings, (n + 1, n + 1), and ``inside`` of :class:`HeatNetwork`.

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
    return full[retained, retained] + full[retained, gone] @ follow, inside
