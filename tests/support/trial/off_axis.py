"""A moving part beside the axis: a magnet in three dimensions, a plunger by its eccentric gap.

The magnet is two discs of magnetic charge, the core an equipotential: rings of charge inside it, a Fourier series in
the angle, cancel the magnet's potential on its surface. The solved fields of the drawing are multiplied by the ratios
of energy and flux to those on the axis, at four offsets; between them the change over the squared offset is a
polynomial of it.

References
----------
J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 5.9: magnets as charges; G. Fairweather and
A. Karageorghis, Adv. Comput. Math. 9 (1998) 69: the method of fundamental solutions; W. R. Smythe, Static and Dynamic
Electricity (McGraw-Hill, 1968), section 4.14: eccentric cylinders.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import shapely

from femfit.trial.field_table import HiddenError
from femfit.trial.hidden import is_magnet, is_soft
from support.trial.magnetics import is_rectangle
from support.trial.truth import FIELD, Truth

_ORDERS, _ANGLES = 5, 40
_INSET = 0.35
"""Depth of the rings below the surface, of the smallest part's extent."""

_NODES = (0.25, 0.5, 0.75, 1.0)
_BORE_NODES = (0.5, 0.8)
"""Eccentricities that are solved, over the clearance."""


def beside_the_axis(course):
    """An offset ``everywhere``, another one ``by mount``, or one that grows with the distance of a ``tilted`` guide."""

    def build(device, rng):
        shares = rng.uniform(0.3, 1.0, 32)
        bore = plunger_bore(device.actuator)
        if bore is None:
            magnets = filter(is_magnet, device.actuator.moving.regions)
            limit = 0.5 * max(float(r) for magnet in magnets for r, _ in magnet.vertices_m)
        else:
            limit = 0.8 * (bore[1] - bore[2])

        def fields(device, size, settings):
            share = {
                "everywhere": np.ones(len(settings.run)),
                "by mount": shares[settings.run % 32],
                "tilted": settings.distance / device.actuator.sweep.distances_m[-1],
            }
            offset = abs(size) * share[course]
            if bore is not None:
                return device.change("bore", offset**2, settings)
            return _magnet_beside(device, offset, limit, settings)

        return HiddenError(lambda device: limit / 1.1, FIELD, fields=fields)

    return Truth(build, lacks=_lacks, families=_drawings)


def _magnet_beside(device, offset, largest, settings):
    """What the offset of a magnet, one a reading and up to ``largest`` in m, adds to the fields on the axis."""
    nodes = largest * np.array(_NODES)
    solved = [displaced(device.actuator, float(node), device.drawn.distances) for node in nodes]

    def change(name):
        """Of a ratio, by the polynomial in the squared offset."""
        total = np.zeros(len(offset))
        for node, ratios in zip(nodes, solved, strict=True):
            value = np.interp(np.log(settings.distance), ratios["log_distance"], ratios[name])
            factors = [(offset**2 - x**2) / (node**2 - x**2) for x in nodes if x != node]
            total += value * np.prod(factors, axis=0)
        return offset**2 * total

    passive, ahead, back = (device.drawn.at(settings.distance, sign * settings.current) for sign in (0.0, 1.0, -1.0))
    changes = np.array([change("passive"), change("flux"), change("hall")]) * passive
    changes[0] += change("coil") * 0.5 * (ahead[0] - back[0])
    return changes


def _lacks(actuator):
    if plunger_bore(actuator) is not None:
        return ""
    moving = actuator.moving.regions
    magnets = list(filter(is_magnet, moving))
    if not magnets or any(map(is_soft, moving)) or not all(is_rectangle(magnet.vertices_m) for magnet in magnets):
        return "no moving magnet drawn as a rectangle, and no plunger in a bore"
    if any(map(is_magnet, actuator.fixed)) or _core(actuator).geom_type != "Polygon":
        return "no single core that the displaced magnet could be solved with"
    return "" if min(actuator.sweep.distances_m) > 0.0 else "no distance from the core"


def plunger_bore(actuator):
    """The fixed soft region that a plunger slides through, with its bore's and the plunger's radius; None without."""
    soft = [region for region in actuator.moving.regions if is_soft(region)]
    plunger = max((max(r for r, _ in region.vertices_m) for region in soft), default=0)
    for region in filter(is_soft, actuator.fixed):
        wider = [r for r, z in region.vertices_m if z > 0.0 and plunger < r < 1.3 * plunger]
        if len(wider) > 1:
            return region, min(wider), plunger
    return None


def _drawings(actuator):
    """A plunger that lies off the axis of its bore, as the coaxial gap of the same permeance.

    Per length it is 2 pi / arccosh((a^2 + b^2 - c^2) / (2 a b)) of cylinders of radii a < b with axes c apart.
    """
    if (found := plunger_bore(actuator)) is None:
        return {}
    region, bore, plunger = found
    forms = {}
    for offset in ((bore - plunger) * node for node in _BORE_NODES):
        cosine = (plunger**2 + bore**2 - offset**2) / (2.0 * plunger * bore)
        radius = plunger * float(np.exp(np.arccosh(cosine)))
        vertices = tuple((radius if abs(r - bore) < 1e-9 else r, z) for r, z in region.vertices_m)
        fixed = (replace(part, vertices_m=vertices) if part is region else part for part in actuator.fixed)
        forms[offset**2] = replace(actuator, fixed=tuple(fixed))
    return {"bore": forms}


@dataclass(frozen=True, eq=False)
class Core:
    """A core as rings of charge; everything is even in the angle, as a magnet is that is displaced along angle 0."""

    rings: np.ndarray  # (r, z) in m, shape (J, 2)
    surface: np.ndarray  # Points at which the potential is cancelled, shape (S, 2)
    # Least squares solution per Fourier order, (J, S); order 0 carries the free constant and the total charge as well
    inverse: list

    def energy(self, charge, point, seen_at):
        """Potential (times 4 pi mu_0) of the core's answer to point charges; places are cylindrical (r, angle, z)."""
        to_surface = _harmonics(self.surface, point[:, [0, 2]], _ORDERS)
        from_rings = _harmonics(seen_at[:, [0, 2]], self.rings, _ORDERS)
        result = np.zeros(len(seen_at))
        for order in range(_ORDERS):
            goal = -to_surface[order] @ (charge * np.cos(order * point[:, 1]))
            density = self.density(goal, order)
            result += (2.0 if order else 1.0) * np.cos(order * seen_at[:, 1]) * (from_rings[order] @ density)
        return result

    def density(self, goal, order):
        """Charge of the rings that has a potential on the surface."""
        return (self.inverse[order] @ (goal if order else np.append(goal, 0.0)))[: len(self.rings)]


def _core(actuator):
    return shapely.union_all([shapely.Polygon(region.vertices_m) for region in actuator.fixed if is_soft(region)])


def core_of(actuator):
    """The core of a drawing as rings of charge."""

    def along(line, count):
        return np.array([line.interpolate((k + 0.5) / count, normalized=True).coords[0] for k in range(count)])

    body = _core(actuator)
    depth = _INSET * min(np.ptp(region.vertices_m, axis=0).min() for region in actuator.fixed if is_soft(region))
    surface, rings = along(body.exterior, 120), along(body.buffer(-depth, join_style="mitre").exterior, 50)
    zeroth, *others = _harmonics(surface, rings, _ORDERS)
    # Potential = constant, total charge = 0; weighted so that the latter holds
    heavy = 1e3 * np.abs(zeroth).max()
    zeroth = np.block([[zeroth, -np.ones((len(surface), 1))], [heavy * np.ones((1, len(rings))), np.zeros((1, 1))]])
    return Core(rings, surface, [np.linalg.pinv(matrix, rcond=1e-10) for matrix in (zeroth, *others)])


@lru_cache(maxsize=4)
def displaced(actuator, offset, distances, count=15):
    """Relative change of readings by a magnet's sideways ``offset``, over its square, at ``log_distance``.

    Of the current-free force (``passive``), of the force per ampere (``coil``), of the field at the Hall element, and
    of the magnet's flux linkage.
    """
    core, d = core_of(actuator), np.geomspace(*distances, count)

    def energy(distance, off):
        charge, point = magnet_charges(actuator, distance, off)
        return float(0.5 * charge @ core.energy(charge, point, point))

    def hall(distance, off):
        """-d/dz of the potential at the element, up to the factor of the potential."""
        charge, point = magnet_charges(actuator, distance, off)
        x, y = point[:, 0] * np.cos(point[:, 1]), point[:, 0] * np.sin(point[:, 1])
        step, radius, potential = 1e-4, actuator.hall.radius_m, []
        for z in actuator.hall.height_m + np.array([2.0 * step, step]):
            direct = charge @ (1.0 / np.sqrt((x - radius) ** 2 + y**2 + (point[:, 2] - z) ** 2))
            potential.append(float(direct + core.energy(charge, point, np.array([[radius, 0.0, z]]))[0]))
        return -(potential[0] - potential[1]) / step

    def slope(function):
        return lambda x, off: (function(x * 1.001, off) - function(x * 0.999, off)) / (2e-3 * x)

    def ratio(function):
        at_offset, on_axis = (np.array([function(x, off) for x in d]) for off in (offset, 0.0))
        return (at_offset / on_axis - 1.0) / offset**2

    def flux(distance, off):
        return coil_flux(actuator, core, distance, off)

    return {
        "log_distance": np.log(d),
        "passive": ratio(slope(energy)),
        "coil": ratio(slope(flux)),
        "hall": ratio(hall) if actuator.hall else np.zeros(count),
        "flux": ratio(flux),
    }


def magnet_charges(actuator, distance, offset):
    """Charges of the magnets' faces, displaced along angle 0, and their places (r, angle, z)."""
    radial, weight = np.polynomial.legendre.leggauss(4)
    angle = np.pi * (np.arange(8) + 0.5) / 8  # one half stands for both
    charges, places = [], []
    for region in filter(is_magnet, actuator.moving.regions):
        r, z = np.array(region.vertices_m).T
        low, high = r.min() ** 2, r.max() ** 2
        ring = np.sqrt(low + 0.5 * (radial + 1.0) * (high - low))  # equal areas: Gauss points of r^2
        x, y = offset + np.outer(ring, np.cos(angle)), np.outer(ring, np.sin(angle))
        share = np.repeat(0.5 * weight * np.pi * (high - low) / len(angle), len(angle))
        for height, sign in ((z.max(), 1.0), (z.min(), -1.0)):
            charges.append(sign * region.material.remanence_T * share)
            z_all = np.full(x.size, height + distance)
            places.append(np.stack([np.hypot(x, y).ravel(), np.arctan2(y, x).ravel(), z_all], axis=1))
    return np.concatenate(charges), np.concatenate(places)


def coil_flux(actuator, core, distance, offset):
    """Flux of the coil through the magnets, up to a factor: the core's potential rises along the winding alone."""
    charge, point = magnet_charges(actuator, distance, offset)
    z = np.array(actuator.coil.vertices_m)[:, 1]
    density = core.density(np.clip((core.surface[:, 1] - z.min()) / np.ptp(z), 0.0, 1.0), 0)
    return float(charge @ (_harmonics(point[:, [0, 2]], core.rings, 1)[0] @ density))


def _harmonics(seen_at, ring, orders):
    """Mean over the angle of cos(order angle) / distance between points (r, z), shape (orders, P, J)."""
    angle = np.pi * (np.arange(_ANGLES) + 0.5) / _ANGLES
    r, z = seen_at[:, 0][:, None, None], seen_at[:, 1][:, None, None]
    a, b = ring[:, 0][None, :, None], ring[:, 1][None, :, None]
    apart = np.sqrt(np.maximum(r**2 + a**2 + (z - b) ** 2 - 2.0 * r * a * np.cos(angle), 1e-18))
    waves = np.cos(np.arange(orders) * angle[:, None]) / _ANGLES
    return np.moveaxis((1.0 / apart) @ waves, 2, 0)
