r"""Flux linkages of windings without current: a quadrature of the solved field over their sections.

A winding of N turns that fill a section of area A links (N / A) integral 2 pi r A_phi = (N / A) integral 2 pi r^2 w.
Without a current it changes nothing, so the mesh knows nothing of it, and it may share its section with a coil. The
section is cut at the heights of its corners; in each strip the nodes of Gauss lie along z, and along r between edges.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from ngsolve import GridFunction

from femfit.core.errors import FieldSolverError
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import pickup_column
from femfit.device.electrics import PickupCoil
from femfit.device.parts import Actuator
from femfit.field.moving_mesh import MovingMesh

NODES = 6
"""Numerical: of Gauss along each side of a strip, exact for polynomials of degree 11; fields have degree 5 or so."""

INSIDE = 0.9
"""Numerical: of the radius up to which the field is solved; the mesh's outer edges are chords of that circle."""

STRIPS = 4
"""Numerical: a section is cut into at least as many strips, and each of them into as many cells."""


def pickups_at(actuator: Actuator, moving: MovingMesh, distance: float) -> Callable[[GridFunction], dict[str, float]]:
    """What a solution gives each pickup coil's column, in Wb, with the moving part at a distance in m."""
    placed, outer = {}, moving.layout.outer_radius
    for coil in (sensor for sensor in actuator.sensors if isinstance(sensor, PickupCoil)):
        farthest = max(float(np.hypot(r, z)) for r, z in coil.vertices_m)
        if farthest > INSIDE * outer:
            raise FieldSolverError(
                f"Pickup coil {coil.name!r} must lie near the actuator; it reaches {1e3 * farthest:.4g} mm from "
                f"the origin, and the field ends at {1e3 * outer:.4g} mm. Draw it nearer."
            )
        points, weights = section_nodes(coil.vertices_m)
        radius, height = points.T + np.array([[0.0], [distance if coil.moves else 0.0]])
        density = coil.turns / weights.sum() * 2.0 * np.pi * points[:, 0] ** 2
        placed[pickup_column(coil.name)] = moving.mesh(radius, height), density * weights
    return lambda w: {name: float(weights @ w(places)[:, 0]) for name, (places, weights) in placed.items()}


def section_nodes(corners: tuple[tuple[float, float], ...]) -> tuple[FloatArray, FloatArray]:
    """Nodes (n, 2) and weights (n,) for integrals over the inside of a polygon; the weights sum to its area."""
    starts = np.array(corners)
    stops, heights = np.roll(starts, -1, axis=0), np.unique(starts[:, 1])
    points: list[FloatArray] = []
    weights: list[FloatArray] = []
    for low, high in pairwise(heights):
        strips = max(1, int(np.ceil(STRIPS * (high - low) / np.ptp(heights))))
        for z, along in zip(*_in_cells(low, high, strips), strict=True):
            crosses = (starts[:, 1] > z) != (stops[:, 1] > z)
            a, b = starts[crosses], stops[crosses]
            edges = np.sort(a[:, 0] + (z - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]))
            for near, far in zip(edges[::2], edges[1::2], strict=True):
                r, across = _in_cells(near, far, STRIPS)
                points.append(np.column_stack([r, np.full_like(r, z)]))
                weights.append(along * across)
    return np.concatenate(points), np.concatenate(weights)


def _in_cells(low: float, high: float, cells: int) -> tuple[FloatArray, FloatArray]:
    """Nodes of Gauss and their weights between two ends, in cells of equal width."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    ends = np.linspace(low, high, cells + 1)
    half = 0.5 * np.diff(ends)[:, None]
    return (0.5 * (ends[1:] + ends[:-1])[:, None] + half * x).ravel(), (half * w).ravel()
