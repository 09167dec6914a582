r"""Flux linkage of windings without current: quadrature of the solved field over their sections.

A winding of N turns that fill a section of area A links (N / A) integral 2 pi r A_phi = (N / A) integral 2 pi r^2 w.
Without a current it changes nothing, so the mesh knows nothing of it, and it may share its section with a coil. The
section is cut at the heights of its corners; in each strip the nodes of Gauss lie along z, and along r between edges.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from ngsolve import GridFunction

from femfit.core.arrays import FloatArray
from femfit.core.errors import FieldSolverError
from femfit.device.parts import Actuator
from femfit.device.sensors import PickupCoil
from femfit.field.moving_mesh import MovingMesh

NODES = 6
"""Numerical: of Gauss along each side of a strip, exact for polynomials of degree 11; fields have degree 5 or so."""

INSIDE = 0.9
"""Numerical: of the radius up to which the field is solved; the mesh's outer edges are chords of that circle."""

STRIPS = 4
"""Numerical: a section is cut into at least as many strips, and each of them into as many cells."""


class PickupCoils:
    """The pickup coils of an actuator on a mesh; none where the drawing has none."""

    def __init__(self, actuator: Actuator, moving: MovingMesh) -> None:
        self._moving = moving
        coils = [sensor for sensor in actuator.sensors if isinstance(sensor, PickupCoil)]
        for coil in coils:
            farthest = max(float(np.hypot(r, z)) for r, z in coil.vertices_m)
            if farthest > INSIDE * moving.layout.outer_radius:
                raise FieldSolverError(
                    f"Pickup coil {coil.name!r} must lie near the actuator; it reaches {1e3 * farthest:.4g} mm from "
                    f"the origin, and the field ends at {1e3 * moving.layout.outer_radius:.4g} mm. Draw it nearer."
                )
        self._coils = [(coil, *section_nodes(coil.vertices_m)) for coil in coils]

    def at(self, distance: float) -> "PlacedCoils":
        """The coils where they are with the moving part at a distance in m."""
        placed = {}
        for coil, points, weights in self._coils:
            physical = points + np.array([0.0, distance if coil.moves else 0.0])
            found = self._moving.unstretched(physical, distance)
            density = coil.turns / weights.sum() * 2.0 * np.pi * points[:, 0] ** 2
            placed[coil.name] = self._moving.mesh(found[:, 0], found[:, 1]), density * weights
        return PlacedCoils(placed)


class PlacedCoils:
    """Points of the mesh and weights for each coil."""

    def __init__(self, placed: Mapping[str, tuple[Any, FloatArray]]) -> None:
        self._placed = placed

    def linked(self, w: GridFunction) -> dict[str, float]:
        """Flux linkage of each coil in Wb with a solution."""
        return {name: float(weights @ w(at)[:, 0]) for name, (at, weights) in self._placed.items()}


def section_nodes(corners: tuple[tuple[float, float], ...]) -> tuple[FloatArray, FloatArray]:
    """Nodes (n, 2) and weights (n,) for integrals over the inside of a polygon; the weights sum to its area."""
    outline = np.array(corners)
    starts, stops = outline, np.roll(outline, -1, axis=0)
    x, w = np.polynomial.legendre.leggauss(NODES)
    heights = np.unique(outline[:, 1])
    points: list[FloatArray] = []
    weights: list[FloatArray] = []
    for low, high in pairwise(heights):
        cuts = np.linspace(low, high, max(1, int(np.ceil(STRIPS * (high - low) / np.ptp(heights)))) + 1)
        for bottom, top in pairwise(cuts):
            half = 0.5 * (top - bottom)
            for z, share in zip(0.5 * (bottom + top) + half * x, w, strict=True):
                crosses = (starts[:, 1] > z) != (stops[:, 1] > z)
                a, b = starts[crosses], stops[crosses]
                edges = np.sort(a[:, 0] + (z - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]))
                for left, right in zip(edges[::2], edges[1::2], strict=True):
                    ends = np.linspace(left, right, STRIPS + 1)
                    quarter = 0.5 * np.diff(ends)[:, None]
                    r = (0.5 * (ends[1:] + ends[:-1])[:, None] + quarter * x).ravel()
                    points.append(np.column_stack([r, np.full_like(r, z)]))
                    weights.append(half * share * (quarter * w).ravel())
    return np.concatenate(points), np.concatenate(weights)
