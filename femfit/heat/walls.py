"""Ways of heat out of a part: through a winding to its faces, and from faces to other parts or the open air.

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

import numpy as np
import shapely
from numpy.typing import NDArray

from femfit.core.numerics import COPPER_RESISTIVITY_20C, FloatArray, IntArray
from femfit.device.parts import Coil, copper_growth
from femfit.device.thermal import LORENZ_NUMBER, METAL_CAPACITY, ROOM_K

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

    part: IntArray  # Which part's
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
    filled = _closed(shapely.union_all(revolved), widest)
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
    r, far = place[:, 0], np.abs(place[:, 0] + gap * normal[:, 0])
    side = np.where(np.abs(normal[:, 0]) > np.abs(normal[:, 1]), normal[:, 0] > 0.0, 2 + (normal[:, 1] > 0.0))
    return Faces(which, side.astype(np.int64), facing, 2.0 * np.pi * length * _log_mean(r, far), gap)


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


def _closed(filled: shapely.Geometry, widest: float) -> shapely.Geometry:
    """The parts with gaps narrower than ``widest``, and with all that these close in."""
    closed = filled.buffer(0.5 * widest).buffer(-0.5 * widest)
    rings = [piece.exterior for piece in getattr(closed, "geoms", [closed])]
    return shapely.union_all([shapely.Polygon(ring) for ring in rings])


def _distance(origins: NDArray[np.object_], rays: NDArray[np.object_], section: shapely.Geometry) -> FloatArray:
    """How far away along each ray a part is; infinite where it is not met."""
    distances = np.full(len(rays), np.inf)
    shapely.prepare(section)
    meets = shapely.intersects(section, rays)
    distances[meets] = shapely.distance(origins[meets], shapely.intersection(rays[meets], section))
    return distances


def _log_mean(first: FloatArray, second: FloatArray) -> FloatArray:
    """(b - a) / ln(b / a), and a where they are alike; a floor keeps rays that reach the axis finite."""
    a, b = np.maximum(first, BESIDE), np.maximum(second, BESIDE)
    alike = np.abs(b - a) < 1e-6 * a
    ratio = np.where(alike, np.e, b / a)
    return np.asarray(np.where(alike, 0.5 * (a + b), (b - a) / np.log(ratio)))


FILLER_CAPACITY = 1e6
"""Assumed: in J/(m^3 K), of enamel (2e6) and air between strands."""

DENSEST = math.pi / math.sqrt(12.0)
"""The largest share that round wires fill."""


@dataclass(frozen=True)
class WindingHeat:
    """What a winding's wire makes of its section."""

    copper_share: float
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
    return WindingHeat(share, across, capacity, cold)


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
