"""A moving part beside the axis: a magnet in three dimensions, a plunger by its eccentric gap.

The magnet is two discs of magnetic charge. The core is so permeable that its scalar potential is constant: rings of
charge inside it (their density a Fourier series in the angle) are chosen so that they cancel the magnet's potential on
the core's surface, order by order. The energy of the magnet in their field, and the flux of the coil through it from
the solved field of the drawing, are functions of distance and displacement; only their ratios to the values on the axis
are used, by which the solved fields of the drawing are multiplied. They are solved at four offsets; between them the
change over the squared offset is a polynomial of it.

References
----------
J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 5.9: magnets as charges; G. Fairweather and
A. Karageorghis, Adv. Comput. Math. 9 (1998) 69: the method of fundamental solutions; W. R. Smythe, Static and Dynamic
Electricity (McGraw-Hill, 1968), section 4.14: eccentric cylinders.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import shapely

from femfit.core.numerics import FloatArray
from femfit.device.parts import Actuator, Region
from femfit.trial.field_table import Conditions, Device, HiddenError
from femfit.trial.hidden import is_magnet, is_soft
from support.trial.magnetics import is_rectangle
from support.trial.truth import FIELD, Drawings, Truth

_ORDERS, _ANGLES = 5, 40
_INSET = 0.35
"""Depth of the rings below the surface, of the smallest part's extent."""

_NODES = (0.25, 0.5, 0.75, 1.0)
_BORE_NODES = (0.5, 0.8)
"""Eccentricities that are solved, over the clearance."""


def beside_the_axis(course: Literal["everywhere", "by mount", "tilted"]) -> Truth:
    """The same offset throughout, another one with each run, or one that grows with the distance: a tilted guide."""

    def build(device, rng):
        shares = rng.uniform(0.3, 1.0, 32)
        bore = plunger_bore(device.actuator)
        radius = _magnet_radius(device.actuator) if bore is None else bore[1] - bore[2]
        limit = radius * (0.5 if bore is None else 0.8)

        def offset(size, settings):
            far = device.actuator.sweep.distances_m[-1]
            share = {
                "everywhere": np.ones(len(settings.run)),
                "by mount": shares[settings.run % 32],
                "tilted": settings.distance / far,
            }
            return abs(size) * share[course]

        def fields(device, size, settings):
            if bore is not None:
                return device.change("bore", offset(size, settings) ** 2, settings)
            return magnet_beside(device, offset(size, settings), limit, settings)

        return HiddenError(lambda device: limit / 1.1, FIELD, fields=fields)

    return Truth(build, lacks=_lacks, families=_drawings)


def magnet_beside(device: Device, offset: FloatArray, largest: float, settings: Conditions) -> FloatArray:
    """What the offset of a magnet, one a reading and up to ``largest`` in m, adds to the fields on the axis."""
    nodes = [largest * node for node in _NODES]
    solved = [displaced(device.actuator, node, device.drawn.distances) for node in nodes]
    squared = np.array([node**2 for node in nodes])

    def change(name):
        """Of a ratio, by the polynomial in the squared offset."""
        total = np.zeros(len(offset))
        for k, ratios in enumerate(solved):
            value = np.interp(np.log(settings.distance), ratios.log_distance, getattr(ratios, name))
            factors = [(offset**2 - x) / (squared[k] - x) for x in np.delete(squared, k)]
            total += value * np.prod(factors, axis=0)
        return offset**2 * total

    passive = device.drawn.at(settings.distance, np.zeros_like(settings.current))
    ahead, back = (
        device.drawn.at(settings.distance, settings.current),
        device.drawn.at(settings.distance, -settings.current),
    )
    changes = np.array([change("passive"), change("flux"), change("hall")]) * passive
    changes[0] += change("coil") * 0.5 * (ahead[0] - back[0])
    return changes


def _lacks(actuator: Actuator) -> str:
    if plunger_bore(actuator) is not None:
        return ""
    moving = actuator.moving.regions
    magnets = list(filter(is_magnet, moving))
    if not magnets or any(map(is_soft, moving)) or not all(is_rectangle(magnet.vertices_m) for magnet in magnets):
        return "no moving magnet drawn as a rectangle, and no plunger in a bore"
    if any(map(is_magnet, actuator.fixed)) or _core(actuator).geom_type != "Polygon":
        return "no single core that the displaced magnet could be solved with"
    return "" if min(actuator.sweep.distances_m) > 0.0 else "no distance from the core"


def plunger_bore(actuator: Actuator) -> tuple[Region, float, float] | None:
    """The fixed soft region that a plunger slides through, with its bore's and the plunger's radius; None without."""
    soft = [region for region in actuator.moving.regions if is_soft(region)]
    plunger = max((max(r for r, _ in region.vertices_m) for region in soft), default=0)
    for region in filter(is_soft, actuator.fixed):
        wider = [r for r, z in region.vertices_m if z > 0.0 and plunger < r < 1.3 * plunger]
        if len(wider) > 1:
            return region, min(wider), plunger
    return None


def _drawings(actuator: Actuator) -> Drawings:
    bore = plunger_bore(actuator)
    if bore is None:
        return {}
    offsets = [node * (bore[1] - bore[2]) for node in _BORE_NODES]
    return {"bore": {offset**2: eccentric_bore(actuator, offset) for offset in offsets}}


def eccentric_bore(actuator: Actuator, offset: float) -> Actuator:
    """A plunger that lies off the axis of its bore by ``offset``, as the coaxial gap of the same permeance.

    Between two cylinders of radii a < b whose axes are c apart the permeance is 2 pi / arccosh((a^2 + b^2 - c^2) /
    (2 a b)) per length, which is ln(b / a) in place of the arccosh where c = 0.
    """
    region, bore, plunger = plunger_bore(actuator)
    cosine = (plunger**2 + bore**2 - offset**2) / (2.0 * plunger * bore)
    radius = plunger * float(np.exp(np.arccosh(cosine)))
    vertices = tuple((radius if abs(r - bore) < 1e-9 else r, z) for r, z in region.vertices_m)
    fixed = tuple(replace(part, vertices_m=vertices) if part is region else part for part in actuator.fixed)
    return replace(actuator, fixed=fixed)


def _magnet_radius(actuator: Actuator) -> float:
    return max(float(r) for magnet in filter(is_magnet, actuator.moving.regions) for r, _ in magnet.vertices_m)


@dataclass(frozen=True, eq=False)
class CoreResponse:
    """The core as rings of charge; everything is even in the angle, as a magnet is that is displaced along angle 0."""

    rings: FloatArray  # (r, z) in m, shape (J, 2)
    surface: FloatArray  # Points at which the potential is cancelled, shape (S, 2)
    # Least squares solution per Fourier order, (J, S); order 0 carries the free constant and the total charge as well
    inverse: tuple[FloatArray, ...]

    def energy(self, charge: FloatArray, point: FloatArray, seen_at: FloatArray) -> FloatArray:
        """Potential (times 4 pi mu_0) of the core's answer to point charges; places are cylindrical (r, angle, z)."""
        to_surface = _harmonics(self.surface, point[:, [0, 2]], _ORDERS)
        from_rings = _harmonics(seen_at[:, [0, 2]], self.rings, _ORDERS)
        result = np.zeros(len(seen_at))
        for order in range(_ORDERS):
            goal = -to_surface[order] @ (charge * np.cos(order * point[:, 1]))
            goal = goal if order else np.append(goal, 0.0)
            density = (self.inverse[order] @ goal)[: len(self.rings)]
            both = 2.0 if order else 1.0
            result += both * np.cos(order * seen_at[:, 1]) * (from_rings[order] @ density)
        return result


def _core(actuator: Actuator) -> Any:
    return shapely.union_all([shapely.Polygon(part.vertices_m) for part in actuator.fixed if is_soft(part)])


def core_response(actuator: Actuator) -> CoreResponse:
    """The core of a drawing as rings of charge."""
    body = _core(actuator)
    sizes = [np.ptp(np.array(part.vertices_m), axis=0) for part in actuator.fixed if is_soft(part)]
    depth = _INSET * float(np.min(sizes))
    surface = _along(body.exterior, 120)
    rings = _along(body.buffer(-depth, join_style="mitre").exterior, 50)
    inverse = []
    for order, matrix in enumerate(_harmonics(surface, rings, _ORDERS)):
        if order == 0:  # potential = constant, total charge = 0; weighted so that the latter holds
            heavy = 1e3 * np.abs(matrix).max()
            matrix = np.block(  # noqa: PLW2901
                [[matrix, -np.ones((len(surface), 1))], [heavy * np.ones((1, len(rings))), np.zeros((1, 1))]]
            )
        inverse.append(np.linalg.pinv(matrix, rcond=1e-10))
    return CoreResponse(rings, surface, tuple(inverse))


@dataclass(frozen=True, eq=False)
class OffAxis:
    """Change of a displaced magnet's readings over the displacement squared in 1/m^2, relative, shape (K,)."""

    log_distance: FloatArray  # In m, ascending
    passive: FloatArray  # Of the current-free force
    coil: FloatArray  # Of the force per ampere, and the flux linkage's slope
    hall: FloatArray  # Of the field at the Hall element
    flux: FloatArray  # Of the magnet's flux linkage itself


@lru_cache(maxsize=4)
def displaced(actuator: Actuator, offset: float, distances: tuple[float, float], count: int = 15) -> OffAxis:
    """Solve a magnet that is displaced sideways by ``offset`` over a range of distances, all in m."""
    core = core_response(actuator)
    d = np.geomspace(*distances, count)
    step = 1e-3 * d

    def energy(distance, off):
        charge, point = _magnet_charges(actuator, distance, off)
        return float(0.5 * charge @ core.energy(charge, point, point))

    def flux(distance, off):
        charge, point = _magnet_charges(actuator, distance, off)
        return float(charge @ _coil_potential(actuator, core, point))

    def hall(distance, off):
        charge, point = _magnet_charges(actuator, distance, off)
        return _axial_field(actuator, core, charge, point)

    def ratio(function, slope):
        def values(off):
            if not slope:
                return np.array([function(x, off) for x in d])
            return np.array(
                [(function(x + s, off) - function(x - s, off)) / (2.0 * s) for x, s in zip(d, step, strict=True)]
            )

        return (values(offset) / values(0.0) - 1.0) / offset**2

    return OffAxis(
        log_distance=np.log(d),
        passive=ratio(energy, slope=True),
        coil=ratio(flux, slope=True),
        hall=ratio(hall, slope=False) if actuator.hall else np.zeros(count),
        flux=ratio(flux, slope=False),
    )


def _magnet_charges(actuator: Actuator, distance: float, offset: float) -> tuple[FloatArray, FloatArray]:
    """Charges of the magnets' faces, displaced along angle 0, and their places (r, angle, z)."""
    radial, weight = np.polynomial.legendre.leggauss(4)
    angle = np.pi * (np.arange(8) + 0.5) / 8  # one half stands for both
    charges, places = [], []
    for region in filter(is_magnet, actuator.moving.regions):
        r, z = np.array(region.vertices_m).T
        low, high = r.min() ** 2, r.max() ** 2
        ring = np.sqrt(low + 0.5 * (radial + 1.0) * (high - low))  # equal areas: Gauss points of r^2
        for height, sign in ((z.max(), 1.0), (z.min(), -1.0)):
            x = offset + np.outer(ring, np.cos(angle))
            y = np.outer(ring, np.sin(angle))
            share = np.repeat(0.5 * weight * np.pi * (high - low) / len(angle), len(angle))
            charges.append(sign * region.material.remanence_T * share)
            z_all = np.full(x.size, height + distance)
            places.append(np.stack([np.hypot(x, y).ravel(), np.arctan2(y, x).ravel(), z_all], axis=1))
    return np.concatenate(charges), np.concatenate(places)


def _coil_potential(actuator: Actuator, core: CoreResponse, point: FloatArray) -> FloatArray:
    """Scalar potential of the excited core at points outside, up to a factor.

    Ampere's law makes the surface potential of a very permeable core rise by the ampere-turns along the winding and
    stay constant beyond it.
    """
    z = np.array(actuator.coil.vertices_m)[:, 1]
    goal = np.append(np.clip((core.surface[:, 1] - z.min()) / np.ptp(z), 0.0, 1.0), 0.0)
    density = (core.inverse[0] @ goal)[: len(core.rings)]
    return np.asarray(_harmonics(point[:, [0, 2]], core.rings, 1)[0] @ density)


def _axial_field(actuator: Actuator, core: CoreResponse, charge: FloatArray, point: FloatArray) -> float:
    """-d/dz of the potential at the Hall element, up to the factor of the potential."""
    element = actuator.hall
    if element is None:
        return 0.0
    step = 1e-4
    potential = []
    for height in (element.height_m + 2.0 * step, element.height_m + step):
        settings = np.array([[element.radius_m, 0.0, height]])
        x, y = point[:, 0] * np.cos(point[:, 1]), point[:, 0] * np.sin(point[:, 1])
        direct = charge @ (1.0 / np.sqrt((x - element.radius_m) ** 2 + y**2 + (point[:, 2] - height) ** 2))
        potential.append(float(direct + core.energy(charge, point, settings)[0]))
    return -(potential[0] - potential[1]) / step


def _harmonics(seen_at: FloatArray, ring: FloatArray, orders: int) -> FloatArray:
    """Mean over the angle of cos(order angle) / distance between points (r, z), shape (orders, P, J)."""
    angle = np.pi * (np.arange(_ANGLES) + 0.5) / _ANGLES
    r, z = seen_at[:, 0][:, None, None], seen_at[:, 1][:, None, None]
    a, b = ring[:, 0][None, :, None], ring[:, 1][None, :, None]
    apart = np.sqrt(np.maximum(r**2 + a**2 + (z - b) ** 2 - 2.0 * r * a * np.cos(angle), 1e-18))
    waves = np.cos(np.arange(orders) * angle[:, None]) / _ANGLES
    return np.moveaxis((1.0 / apart) @ waves, 2, 0)


def _along(line: Any, count: int) -> FloatArray:
    """Points at equal steps along a closed line."""
    steps = (np.arange(count) + 0.5) / count
    return np.array([line.interpolate(s, normalized=True).coords[0] for s in steps])
