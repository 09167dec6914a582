r"""How W' changes with the numbers of a drawing while the field's coefficients stay: all that there is of dW'/dp.

W'(p) = max over w of G(w; p), the discrete co-energy J A - u(B) integrated over the mesh, so that dW'/dp = dG/dp at the
solved w, in the discrete problem too: what w changes adds nothing. With a displacement V of the mesh, w carried along,

    dG = - integral (H . dB + u (div V + V_r / r)) 2 pi r,
    dB_r = - V_r w_z + r dV/dz . grad w,    dB_z = V_r w_r - r dV/dr . grad w.

For displacements of first order this is a sum of forces on the vertices times their velocities, so that all dimensions
cost one integral. A winding's section C moves by itself, by V_c, while the mesh passes under its current density j:
d(j w) = integral over C of j (div(r^2 w V_c) - r^2 V . grad w) 2 pi. Along edges of magnetic parts the motion that
vertices leave (:mod:`femfit.field.outline_motion`) counts H_t [B_t] - [u], the jumps from outside to inside.

Where eddy currents flow at a complex frequency s, G without magnets is a form in the complex fields, whose energy
has s sigma r^2 w^2 / 2 in solid parts and s sigma b^2 B . B / 24 in stacks of sheets beside u.

References
----------
A. Kameari, IEEE Trans. Magn. 29 (1993) 1466: nodal forces; S. McFee, J. P. Webb and D. A. Lowther, IEEE Trans. Magn.
24 (1988) 439.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from ngsolve import H1, Grad, GridFunction, InnerProduct, LinearForm, VectorH1, dx, grad, x

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.parts import Actuator, Coil, LinearMaterial
from femfit.field.layout import coil_region
from femfit.field.material_points import Medium
from femfit.field.moving_mesh import FieldPoints, MovingMesh, PlacedPoints
from femfit.field.outline_motion import OutlineMotion
from femfit.field.weak_form import RADIAL_WEIGHT_ORDER, materials

BESIDE = 1e-7
"""Numerical: how far beside an edge, in m, its two sides are looked at."""


_AIR = Medium(LinearMaterial("air", 1.0))
"""Of all places that no material fills."""

Media = list[tuple[IntArray, Medium]]
"""Places with the medium that fills them."""


def _responses(media: Media, b: FloatArray, rw: FloatArray, s: complex) -> tuple[Any, Any, Any]:
    """As :meth:`Medium.respond`, at places of which some lie in air."""
    h, u, _ = _AIR.respond(b, rw, 0.0)
    rings = np.zeros_like(rw)
    for places, medium in media:
        h[:, places], u[places], rings[places] = medium.respond(b[:, places], rw[places], s)
    return h, u, rings


class ExplicitSlopes:
    """dG/dp for the numbers of a drawing, on one mesh.

    Parameters
    ----------
    still : array, shape (vertices,)
        Vertices that do not move with any number.
    """

    def __init__(
        self, space: H1, actuator: Actuator, moving: MovingMesh, numbers: Sequence[DrawnNumber], still: BoolArray
    ) -> None:
        share = moving.vertex_share
        self.points, self._space, self._numbers = FieldPoints(space, share), space, numbers
        motion = OutlineMotion(space.mesh, actuator, moving.reference, numbers)
        velocities = motion.velocities(still)
        self._velocities = velocities.reshape(len(numbers), -1)
        self._loads = self._coil_slopes(motion, velocities)
        self._named = materials(actuator)
        self._media = [(self.points.of_region(name), Medium(material)) for name, material in self._named.items()]
        self._changes: list[list[tuple[IntArray, Medium, Medium]]] = []
        for number in numbers:
            larger, smaller = materials(number.larger), materials(number.smaller)
            changed = [name for name in self._named if larger[name] != smaller[name]]
            self._changes.append(
                [(self.points.of_region(name), Medium(larger[name]), Medium(smaller[name])) for name in changed]
            )
        left = self._left = motion.remainder(velocities)
        self._sides = [
            PlacedPoints(space, left.points + sign * BESIDE * left.normals, left.points[:, 0], share)
            for sign in (-1.0, 1.0)
            if len(left.points)
        ]
        self._side_media, self._differs = self._media_of_sides()

    def sample(self, states: FloatArray) -> FloatArray:
        """All that :meth:`evaluate` needs of states (unknowns, k), linear in them; shape (.., k)."""
        linked = np.tensordot(self._loads, states, axes=1).reshape(-1, states.shape[1])
        return np.concatenate([self.points.fields(states), *(side.fields(states) for side in self._sides), linked])

    def evaluate(self, samples: Any, currents: FloatArray, stretch: float, s: complex = 0.0) -> Any:
        """dG/dp in J per unit for samples (.., k) with the mesh stretched by so much in m; shape (k, numbers).

        ``currents`` are in A, of shape (k, circuits); at a frequency s in 1/s samples are complex.
        """
        points, (count, edge) = self.points, (3 * len(self.points.weight), 3 * len(self._left.points))
        parts = np.split(samples, [count, count + edge, count + 2 * edge])
        shear, b, w, w_r, w_z, density = points.seen(parts[0], stretch)
        r = points.radius[:, None]
        field, u, rings = _responses(self._media, density, r * w, s)
        h_r, h_z = field * r
        weight = 2.0 * math.pi * points.weight[:, None] * b
        values, u = h_z * w_r - h_r * w_z + u + 3.0 * rings, r * (u + rings)  # the rings' r^3 has the slope 3 r^2
        slope_r, slope_z = weight * r * w_r, weight * r * w_z
        moved = [(weight * values, weight * u - slope_r * h_z, slope_r * h_r)]
        moved.append((np.zeros_like(u), -slope_z * h_z, weight * u + slope_z * h_r))
        nodal = [points.nodal(value, in_r, in_z / b - shear * in_r) for value, in_r, in_z in moved]
        result = -self._velocities @ np.concatenate(nodal)
        result += np.einsum("pck,kc->pk", parts[3].reshape(*self._loads.shape[:2], samples.shape[1]), currents)
        for k, changes in enumerate(self._changes):
            for places, larger, smaller in changes:
                ends = [medium.respond(density[:, places], (r * w)[places], s) for medium in (larger, smaller)]
                change = ends[0][1] + ends[0][2] - ends[1][1] - ends[1][2]
                result[k] -= (weight[places] * r[places] * change).sum(axis=0) / (2.0 * self._numbers[k].step)
        return np.asarray((result + self._along_edges(parts[1], parts[2], stretch, s)).T)

    def largest_in_parts(self, samples: FloatArray) -> float:
        """The largest slope of w in a part with a material, or anywhere where there is none."""
        _, w_r, w_z = samples[: 3 * len(self.points.weight)].reshape(3, len(self.points.weight), -1)
        indices = np.concatenate([indices for indices, _ in self._media]) if self._media else slice(None)
        return float(max(np.abs(w_r[indices]).max(), np.abs(w_z[indices]).max()))

    def _coil_slopes(self, motion: OutlineMotion, velocities: FloatArray) -> FloatArray:
        """Slopes of the loads of 1 A; shape (numbers, circuits, unknowns)."""
        actuator = motion.actuator
        circuits = [circuit.name for circuit in actuator.circuits]
        result = np.zeros((len(self._numbers), len(circuits), self._space.ndof))
        space, v = VectorH1(self._space.mesh, order=1), self._space.TestFunction()
        passing, coil_field = GridFunction(space), GridFunction(space)
        for place, coil in enumerate(actuator.coils):
            over = dx(coil_region(coil), bonus_intorder=RADIAL_WEIGHT_ORDER)
            density = 2.0 * math.pi * coil.sign * _density(coil)
            plain = LinearForm(2.0 * math.pi * coil.sign * x**2 * v * over).Assemble().vec.FV().NumPy()
            divergence = v * (2.0 * x * coil_field[0] + x**2 * (Grad(coil_field)[0, 0] + Grad(coil_field)[1, 1]))
            slope = LinearForm(density * (divergence + x**2 * InnerProduct(coil_field - passing, grad(v))) * over)
            motions = zip(motion.of_coil(coil_region(coil)), velocities, self._numbers, strict=True)
            for k, (of_coil, of_mesh, number) in enumerate(motions):
                coil_field.vec.FV().NumPy()[:], passing.vec.FV().NumPy()[:] = of_coil.ravel(), of_mesh.ravel()
                larger, smaller = (_density(device.coils[place]) for device in (number.larger, number.smaller))
                slope.Assemble()
                change = slope.vec.FV().NumPy() + (larger - smaller) / (2.0 * number.step) * plain
                result[k, circuits.index(coil.circuit)] += change
        return result

    def _media_of_sides(self) -> tuple[list[Media], BoolArray]:
        """The media inside and outside of edges with a remainder, and where the two sides differ."""
        if not self._sides:
            return [], np.zeros(0, dtype=np.bool_)
        filled = list(self._named.values())
        number = self._space.mesh.MaterialCF({name: float(k) for k, name in enumerate(self._named)}, default=-1.0)
        inside = np.array([list(self._named).index(name) for name in self._left.inside])
        outside = self._sides[1].numbers_of(number).round().astype(np.int64)
        media = [
            [(np.flatnonzero(side == k), medium) for k, (_, medium) in enumerate(self._media)]
            for side in (inside, outside)
        ]
        differs = [j < 0 or filled[j] != filled[k] for j, k in zip(outside, inside, strict=True)]
        return media, np.array(differs, dtype=np.bool_)

    def _along_edges(self, inside: Any, outside: Any, stretch: float, s: complex) -> Any:
        if not self._differs.any():
            return 0.0
        rows = []
        for side, values, media in zip(self._sides, (inside, outside), self._side_media, strict=True):
            _, _, w, _, _, b = side.seen(values, stretch)
            h, u, rings = _responses(media, b, side.radius[:, None] * w, s)
            r, z = self._left.normals.T[..., None]
            rows.append((r * b[1] - z * b[0], r * h[1] - z * h[0], u + rings))
        (b_in, h_in, u_in), (b_out, h_out, u_out) = rows
        jump = 0.5 * (h_in + h_out) * (b_in - b_out) - (u_in - u_out)
        return np.asarray(self._left.weights @ (jump * self._differs[:, None]))


def _density(coil: Coil) -> float:
    """Turns per area in 1/m^2."""
    return float(coil.turns / shapely.Polygon(coil.vertices_m).area)
