"""A magnet beside the axis of an axisymmetric core and coil, in three dimensions.

The magnet is two discs of magnetic charge. The core is so permeable that its scalar potential is constant: rings of
charge inside it (their density a Fourier series in the angle) are chosen so that they cancel the magnet's potential on
the core's surface, order by order. The energy of the magnet in their field, and the flux of the coil through it from
the solved field of the drawing, are functions of distance and displacement; only their ratios to the values on the axis
are used, by which the solved fields of the drawing are multiplied.

References
----------
J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 5.9: magnets as charges; G. Fairweather and
A. Karageorghis, Adv. Comput. Math. 9 (1998) 69: the method of fundamental solutions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import shapely

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator
from femfit.trial.drawing_variants import is_magnet, is_soft

_ORDERS, _ANGLES = 5, 40
_INSET = 0.35
"""Depth of the rings below the surface, of the smallest part's extent."""


@dataclass(frozen=True, eq=False)
class CoreResponse:
    """The core as rings of charge.

    Everything is even in the angle, as a magnet is that is displaced along angle 0.

    Parameters
    ----------
    rings : array, shape (J, 2)
        (r, z) in m.
    surface : array, shape (S, 2)
        Points at which the potential is cancelled.
    inverse : tuple of array, each of shape (J, S) or, for order 0, (J + 1, S + 1)
        Least squares solution per Fourier order; order 0 carries the free constant and the total charge.
    """

    rings: FloatArray
    surface: FloatArray
    inverse: tuple[FloatArray, ...]

    def energy(self, charge: FloatArray, point: FloatArray, seen_at: FloatArray) -> FloatArray:
        """Potential (times 4 pi mu_0) of the core's answer to point charges.

        Parameters
        ----------
        charge : array, shape (Q,)
            Of the points.
        point, seen_at : array, shapes (Q, 3) and (P, 3)
            Cylindrical (r, angle, z).
        """
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


def has_one_core(actuator: Actuator) -> bool:
    """Whether the soft fixed parts are one body, as :func:`core_response` needs it; an air coil has none."""
    return bool(_core(actuator).geom_type == "Polygon")


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
    """Ratios of a displaced magnet's readings to those on the axis, on a grid of log distance.

    Parameters
    ----------
    log_distance : array, shape (K,)
        Of the distances in m, ascending.
    passive, coil, hall : array, shape (K,)
        Change over displacement squared in 1/m^2 of: current-free force, force per ampere and flux linkage's slope,
        field at the Hall element.
    flux : array, shape (K,)
        Of the magnet's flux linkage itself.
    """

    log_distance: FloatArray
    passive: FloatArray
    coil: FloatArray
    hall: FloatArray
    flux: FloatArray


@lru_cache(maxsize=4)
def displaced(actuator: Actuator, offset: float, distances: tuple[float, float], count: int = 15) -> OffAxis:
    """Solve a displaced magnet.

    Parameters
    ----------
    offset : float
        Sideways displacement in m.
    distances : (float, float)
        Range in m.
    """
    core = core_response(actuator)
    d = np.geomspace(*distances, count)
    step = 1e-3 * d

    def energy(distance: float, off: float) -> float:
        charge, point = _magnet_charges(actuator, distance, off)
        return float(0.5 * charge @ core.energy(charge, point, point))

    def flux(distance: float, off: float) -> float:
        charge, point = _magnet_charges(actuator, distance, off)
        return float(charge @ _coil_potential(actuator, core, point))

    def hall(distance: float, off: float) -> float:
        charge, point = _magnet_charges(actuator, distance, off)
        return _axial_field(actuator, core, charge, point)

    def ratio(function: Callable[[float, float], float], slope: bool) -> FloatArray:
        def at(off: float) -> FloatArray:
            if not slope:
                return np.array([function(x, off) for x in d])
            return np.array(
                [(function(x + s, off) - function(x - s, off)) / (2.0 * s) for x, s in zip(d, step, strict=True)]
            )

        return np.asarray((at(offset) / at(0.0) - 1.0) / offset**2)

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
            at = np.full(x.size, height + distance)
            places.append(np.stack([np.hypot(x, y).ravel(), np.arctan2(y, x).ravel(), at], axis=1))
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
        at = np.array([[element.radius_m, 0.0, height]])
        x, y = point[:, 0] * np.cos(point[:, 1]), point[:, 0] * np.sin(point[:, 1])
        direct = charge @ (1.0 / np.sqrt((x - element.radius_m) ** 2 + y**2 + (point[:, 2] - height) ** 2))
        potential.append(float(direct + core.energy(charge, point, at)[0]))
    return -(potential[0] - potential[1]) / step


def _harmonics(seen_at: FloatArray, ring: FloatArray, orders: int) -> FloatArray:
    """Mean over the angle of cos(order angle) / distance between points (r, z), shape (orders, P, J)."""
    angle = np.pi * (np.arange(_ANGLES) + 0.5) / _ANGLES
    r, z = seen_at[:, 0][:, None, None], seen_at[:, 1][:, None, None]
    a, b = ring[:, 0][None, :, None], ring[:, 1][None, :, None]
    apart = np.sqrt(np.maximum(r**2 + a**2 + (z - b) ** 2 - 2.0 * r * a * np.cos(angle), 1e-18))
    waves = np.cos(np.arange(orders) * angle[:, None]) / _ANGLES
    return np.moveaxis((1.0 / apart) @ waves, 2, 0)


def _along(line: object, count: int) -> FloatArray:
    """Points at equal steps along a closed line."""
    steps = (np.arange(count) + 0.5) / count
    return np.array([line.interpolate(s, normalized=True).coords[0] for s in steps])  # type: ignore[attr-defined]
