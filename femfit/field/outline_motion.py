r"""How a mesh moves with a number of the drawing: velocities of its vertices, per unit of the number.

Vertices on the outlines of magnetic parts move with their edges, all others smoothly between them (harmonic, of first
order, so that a displacement is known by its vertices). The winding's currents need no edges of the mesh; they move by
themselves (:mod:`femfit.field.explicit_slopes`).

A displacement of first order follows a straight edge, but neither an arc nor a step, where a part's face moves and its
neighbour's in the same plane does not. What is left along such edges enters as Hadamard's boundary integral.

References
----------
J. L. Coulomb, IEEE Trans. Magn. 19 (1983) 2514: derivatives on a mesh that moves; J. Sokolowski and J.-P. Zolesio,
Introduction to Shape Optimization, Springer 1992, section 2.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import ngsolve as ng
import numpy as np
from ngsolve import H1, BilinearForm, Mesh, dx, grad
from scipy.sparse.linalg import splu

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.outlines import arc_circle, turned
from femfit.device.parts import Actuator, Coil, Region
from femfit.field.layout import bulges_of, parts_of
from femfit.field.weak_form import csr, materials

ON_EDGE = 1e-9
"""In m: a vertex of the mesh that is nearer to an edge of the drawing lies on it."""

NODES = 4  # of Gauss along an edge of the mesh, for what a displacement of first order leaves

STEP = 1e-6
"""Numerical: of an edge's way, to either side, for its direction."""

LEFT_OVER = 1e-6
"""Of a number's largest velocity: less than this along an edge is rounding."""


@dataclass(frozen=True, eq=False)
class EdgePoints:
    """Points on a part's edge of the drawing, by the fraction of its way from corner to corner."""

    part: str  # Name of its region
    edge: int
    vertices: IntArray  # Of the mesh, in order along the edge
    fractions: FloatArray


@dataclass(frozen=True, eq=False)
class EdgeRemainder:
    """What vertices leave of the numbers' motion along magnetic edges: points on them and weights."""

    points: FloatArray  # (n, 2), r and z in m on the mesh as it was made
    normals: FloatArray  # (n, 2), out of ``inside``
    inside: tuple[str, ...]  # Region of the mesh at each point, against the normal
    weights: FloatArray  # (numbers, n): normal velocity times 2 pi r ds


class OutlineMotion:
    """The motion of a mesh, made with the moving part at a distance, with each of some numbers of its drawing."""

    def __init__(self, mesh: Mesh, actuator: Actuator, reference: float, numbers: Sequence[DrawnNumber]) -> None:
        self.mesh, self.actuator, self._reference, self.numbers = mesh, actuator, reference, numbers
        self._points = np.array([vertex.point for vertex in mesh.vertices])
        space = H1(mesh, order=1)
        u, v = space.TnT()
        self._stiffness = csr(BilinearForm(grad(u) * grad(v) * dx).Assemble().mat, space.ndof)
        self._outer = _vertices_of(mesh.Boundaries("outer"), mesh)
        self._parts = parts_of(actuator)
        self._drawn = [(parts_of(number.larger), parts_of(number.smaller)) for number in numbers]
        magnetic = [
            name
            for name, material in materials(actuator).items()
            if material.relative_permeability != 1.0 or material.remanence_T or material.conductivity_S_per_m
        ]
        self._edges = [edge for name in magnetic for edge in self._on_edges(name)]

    def velocities(self, still: BoolArray) -> FloatArray:
        """Of the vertices, in m per unit, shape (numbers, 2, vertices), with some of them held."""
        velocities = np.zeros((len(self.numbers), 2, len(self._points)))
        on_edge = np.zeros(len(self._points), dtype=np.bool_)
        for edge in self._edges:
            edge_velocity = self._edge_velocities(edge, edge.fractions)
            at_vertices = velocities[:, :, edge.vertices]
            larger = np.hypot(*np.moveaxis(edge_velocity, 1, 0)) > np.hypot(*np.moveaxis(at_vertices, 1, 0))
            velocities[:, :, edge.vertices] = np.where(larger[:, None], edge_velocity, at_vertices)
            on_edge[edge.vertices] = True
        velocities[:, :, still] = 0.0
        fixed = on_edge | self._outer | still
        axis = self._points[:, 0] < ON_EDGE
        return np.stack(
            [self._extended(velocities[:, 0], fixed | axis), self._extended(velocities[:, 1], fixed)], axis=1
        )

    def of_coil(self, region: str) -> FloatArray:
        """A coil's own motion, of the vertices in its section, as :meth:`velocities`; zero elsewhere."""
        velocities = np.zeros((len(self.numbers), 2, len(self._points)))
        free = _vertices_of(self.mesh.Materials(region), self.mesh)
        for edge in self._on_edges(region):
            velocities[:, :, edge.vertices] = self._edge_velocities(edge, edge.fractions)
            free[edge.vertices] = False
        return np.stack([self._extended(velocities[:, k], ~free) for k in range(2)], axis=1)

    def remainder(self, velocities: FloatArray) -> EdgeRemainder:
        """What is left along the edges of magnetic parts, each edge of the mesh once."""
        x, gauss = np.polynomial.legendre.leggauss(NODES)
        x, gauss = 0.5 * (1.0 + x), 0.5 * gauss
        largest = np.abs(velocities).max(axis=(1, 2), initial=0.0)[:, None]
        places, normals, weights = [np.zeros((2, 0))], [np.zeros((2, 0))], [np.zeros((len(self.numbers), 0))]
        edges_seen, inside = set[tuple[int, int]](), list[str]()
        for edge in self._edges:
            line = self._line(edge.part, edge.edge)
            for k in range(len(edge.vertices) - 1):
                ends = edge.vertices[k : k + 2]
                pair = (int(ends.min()), int(ends.max()))
                if pair in edges_seen:
                    continue
                edges_seen.add(pair)
                t = edge.fractions[k] + x * (edge.fractions[k + 1] - edge.fractions[k])
                points, high, low = (_edge_at(*line, t + step) for step in (0.0, STEP, -STEP))
                tangents = (high - low) / (2.0 * STEP)
                length = np.hypot(*tangents) * (edge.fractions[k + 1] - edge.fractions[k])
                normal = np.array([tangents[1], -tangents[0]]) / np.hypot(*tangents)
                true = self._edge_velocities(edge, t)
                by_vertices = velocities[:, :, ends[0], None] * (1.0 - x) + velocities[:, :, ends[1], None] * x
                remainder = np.einsum("pcn,cn->pn", true - by_vertices, normal)
                if np.any(np.abs(remainder) > LEFT_OVER * largest):
                    places.append(points)
                    normals.append(normal)
                    weights.append(remainder * gauss * length * 2.0 * math.pi * points[0])
                    inside += [edge.part] * NODES
        points, normal, weight = (np.concatenate(rows, axis=1) for rows in (places, normals, weights))
        return EdgeRemainder(points.T, normal.T, tuple(inside), weight)

    def _on_edges(self, part: str) -> list[EdgePoints]:
        """The mesh's vertices on every edge of a part."""
        edges = []
        for edge in range(len(self._parts[part].vertices_m)):
            fractions, away = _projected(self._points, *self._line(part, edge))
            near = np.flatnonzero((away < ON_EDGE) & (fractions > -1e-9) & (fractions < 1.0 + 1e-9))
            order = near[np.argsort(fractions[near])]
            edges.append(EdgePoints(part, edge, order, fractions[order]))
        return edges

    def _line(self, part: str, edge: int) -> tuple[FloatArray, FloatArray, float]:
        """Ends and bulge of an edge on the mesh as it was made."""
        return _edge(self._parts[part], edge, self._reference if part.startswith("moving") else 0.0)

    def _edge_velocities(self, edge: EdgePoints, fractions: FloatArray) -> FloatArray:
        """Of points of an edge at fractions, in m per unit, shape (numbers, 2, points)."""
        result = np.zeros((len(self.numbers), 2, len(fractions)))
        for k, (number, devices) in enumerate(zip(self.numbers, self._drawn, strict=True)):
            larger, smaller = (parts[edge.part] for parts in devices)
            if larger.vertices_m != smaller.vertices_m:
                high, low = (_edge_at(*_edge(shape, edge.edge, 0.0), fractions) for shape in (larger, smaller))
                result[k] = (high - low) / (2.0 * number.step)
        return result

    def _extended(self, values: FloatArray, fixed: BoolArray) -> FloatArray:
        """Harmonic between the fixed vertices; shape (numbers, vertices)."""
        free = np.flatnonzero(~fixed)
        held = np.where(fixed, values, 0.0)
        if not len(free):
            return held
        inner = splu(self._stiffness[free][:, free].tocsc())
        held[:, free] = inner.solve(-(self._stiffness[free] @ held.T)).T
        return held


def _edge(shape: Region | Coil, edge: int, shift: float) -> tuple[FloatArray, FloatArray, float]:
    corners, bulges = shape.vertices_m, bulges_of(shape)
    start, stop = (np.array(corners[k % len(corners)]) + np.array([0.0, shift]) for k in (edge, edge + 1))
    return start, stop, bulges[edge] if bulges else 0.0


def _edge_at(start: FloatArray, stop: FloatArray, bulge: float, t: FloatArray) -> FloatArray:
    """Points (2, n) of an edge at fractions of its way."""
    if not bulge:
        return start[:, None] * (1.0 - t) + stop[:, None] * t
    corner = start[0], start[1]
    centre, _ = arc_circle(corner, (stop[0], stop[1]), bulge)
    return np.reshape(turned(corner, centre, 4.0 * math.atan(bulge) * t), (-1, 2)).T


def _projected(points: FloatArray, start: FloatArray, stop: FloatArray, bulge: float) -> tuple[FloatArray, FloatArray]:
    """Fractions of an edge's way next to points (n, 2), and the points' distances from it in m."""
    if not bulge:
        along = stop - start
        t = (points - start) @ along / (along @ along)
        return t, np.hypot(*(points - start - t[:, None] * along).T)
    centre, radius = arc_circle((start[0], start[1]), (stop[0], stop[1]), bulge)
    angle = 4.0 * math.atan(bulge)
    first = math.atan2(start[1] - centre[1], start[0] - centre[0])
    turned = np.arctan2(points[:, 1] - centre[1], points[:, 0] - centre[0]) - first
    middle = 0.5 * angle
    turned = middle + (turned - middle + math.pi) % (2.0 * math.pi) - math.pi
    return turned / angle, np.abs(np.hypot(*(points - np.array(centre)).T) - radius)


def _vertices_of(region: ng.Region, mesh: Mesh) -> BoolArray:
    return np.array(list(H1(mesh, order=1).GetDofs(region)), dtype=np.bool_)[: mesh.nv]
