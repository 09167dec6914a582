"""What the numbers of a drawing change at a distance: slopes of force, flux linkages and Hall field.

With dW'/dp = E(w, i, d) of :mod:`femfit.field.explicit_slopes` the slopes are its total derivatives along the currents,
the distance and a test current h at the Hall element,

    d(flux linkage_k)/dp = dE/di_k,    dF/dp = -dE/dd,    dB/dp = dE/dh,

each of which needs how w itself changes: one linear solution with the derivative of the field's equations at w,
whatever the number of numbers. E is differenced along the line on which w, i, the mesh and h change together; on one
mesh that moves along, so that the energy of each part's own field, a thousand times what is wanted, does not count.

The inductances at a complex frequency change, too: slopes of L(s), Z = R + s L. With w_k of 1 A in circuit k, (K + s M)
w_k = load_k, 2 G = sum of i_j i_k L_jk(s) is stationary in w, so that

    dL_jk/dp = w_k . d(load_j)/dp + w_j . d(load_k)/dp - w_j^T (dK/dp + s dM/dp) w_k,

the explicit slope of :mod:`femfit.field.explicit_slopes` at the solved fields: no further solution, whatever the
number of numbers.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations, combinations_with_replacement
from typing import Any

import numpy as np
from ngsolve import H1, VOL, ElementId, Mesh

from femfit.core.numerics import ComplexArray, FloatArray
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.electrics import HallElement
from femfit.device.parts import Actuator, LinearMaterial, Region
from femfit.field.explicit_slopes import ExplicitSlopes
from femfit.field.moving_mesh import MovingMesh
from femfit.field.weak_form import FieldArray, hall_fields

STEP = 1e-3
"""Numerical: step of central differences, as a part of the currents, of the clearance and of the field."""

HALL_STEP = 2e-5
"""Numerical: in m, by how much a Hall element is moved for the slope of the field where it sits."""

Solve = Callable[[FloatArray, FloatArray], FloatArray]
"""State (unknowns,) and loads (k, unknowns) -> what the loads change of the state, in the same shape."""


class SignatureRows:
    """Signatures on one mesh."""

    def __init__(
        self, actuator: Actuator, numbers: Sequence[DrawnNumber], moving: MovingMesh, space: H1, loads: FloatArray
    ) -> None:
        mesh = moving.mesh
        self._moving, self._loads = moving, loads
        self._hall, still = np.zeros((0, space.ndof)), np.zeros(mesh.nv, np.bool_)
        self._hall_moves = np.zeros((len(numbers), space.ndof))
        if actuator.hall is not None:
            self._hall = hall_row(actuator.hall, space)[None]
            element = mesh[_element_at(actuator.hall, mesh)]  # which does not move with its vertices
            still[[vertex.nr for vertex in element.vertices]] = True
            for k, number in enumerate(numbers):
                self._hall_moves[k] = _hall_motion(number, space)
        self._slopes = ExplicitSlopes(space, actuator, moving, numbers, still)
        self._step = STEP * moving.layout.clearance
        most = max(abs(i) for axis in (actuator.sweep.currents_A, *actuator.sweep.further_A) for i in axis)
        self._size = STEP * (most or 1.0)  # in A, of differences along the currents

    def of_states(self, distance: float, currents: FloatArray, states: FloatArray, solve: Solve) -> FloatArray:
        """Slopes per unit of each number at points; shape (points, numbers, 1 + circuits + Hall elements).

        Of the force in N, then of each flux linkage in Wb, then of the Hall field in T.

        Parameters
        ----------
        currents, states : array, shapes (points, circuits) and (points, unknowns)
        """
        stretch, rows = distance - self._moving.reference, []
        points, step, largest = self._slopes.points, self._step, self._slopes.largest_in_parts
        held, circuits = np.zeros(len(self._loads)), np.eye(len(self._loads))
        for point, state in zip(currents[:, None], states, strict=True):
            sample = self._slopes.sample(state[:, None])
            fields = sample[: 3 * len(points.weight)]
            closer, farther = (points.air_residual(fields, stretch + s) for s in (-step, step))
            pull = (closer - farther).T / (2.0 * step)  # what a metre of distance changes of the field's equations
            loads = np.concatenate([pull, self._loads, self._hall])
            pulled, *changes = self._slopes.sample(solve(state, loads).T).T[:, :, None]
            centre = sample, point, stretch
            columns = [-self._difference(centre, step, pulled, held, 1.0)]  # -dE/dd
            for change, unit in zip(changes, circuits, strict=False):
                columns.append(self._difference(centre, self._size, change, unit))
            for change in changes[len(circuits) :]:
                # Next to a Hall element the field is that of a point: a step by the largest anywhere would be rounding
                size = STEP * (largest(sample) or 1.0) / largest(change)
                columns.append(self._difference(centre, size, change, held) + self._hall_moves @ state)
            rows.append(np.stack(columns, axis=2))
        return np.concatenate(rows)

    def of_sources(self, distance: float, currents: FloatArray, totals: FloatArray, solve: Solve) -> FloatArray:
        """The same where nothing saturates, from the fields of the magnets and of each circuit's ampere (1 + n, ..).

        All slopes are then quadratic in the currents: some corners of these tell all.
        """
        largest = np.abs(currents).max(axis=0, initial=0.0)
        corners = np.where(largest > 0.0, largest, 1.0) * _corners(currents.shape[1])
        slopes = self.of_states(distance, corners, np.insert(corners, 0, 1.0, axis=1) @ totals, solve)
        return np.tensordot(_quadratic(currents) @ np.linalg.inv(_quadratic(corners)), slopes, axes=1)

    def _difference(
        self,
        centre: tuple[FloatArray, FloatArray, float],
        size: float,
        change: FloatArray,
        fed: FloatArray,
        way: float = 0.0,
    ) -> FloatArray:
        """The slope of E at a centre (samples, currents, stretch) along a change of these."""
        sample, currents, stretch = centre
        evaluate = self._slopes.evaluate
        high, low = (evaluate(sample + s * change, currents + s * fed, stretch + s * way) for s in (size, -size))
        return np.asarray((high - low) / (2.0 * size))


def _corners(circuits: int) -> FloatArray:
    """Points that tell a quadratic form of so many variables; the first of them a linear one."""
    unit = np.eye(circuits)
    return np.array([np.zeros(circuits), *unit, *-unit, *(a + b for a, b in combinations(unit, 2))])


def _quadratic(points: FloatArray) -> FloatArray:
    """1, the variables and their products at points of shape (n, variables)."""
    products = [a * b for a, b in combinations_with_replacement(points.T, 2)]
    return np.column_stack([np.ones(len(points)), points, *products])


def hall_row(hall: HallElement, space: H1) -> FloatArray:
    """The field in T that a Hall element measures, as a product with a state; shape (unknowns,)."""
    dofs = list(space.GetDofNrs(space.mesh[_element_at(hall, space.mesh)]))
    row, units = np.zeros(space.ndof), np.zeros((len(dofs), space.ndof))
    units[range(len(dofs)), dofs] = 1.0
    row[dofs] = hall_fields(hall, space, units)
    return row


def _element_at(hall: HallElement, mesh: Mesh) -> Any:
    return ElementId(VOL, mesh(hall.radius_m, hall.height_m).nr)


def _hall_motion(number: DrawnNumber, space: H1) -> FloatArray:
    """What the place of a Hall element changes of the row that it reads, per unit."""
    larger, smaller = number.larger.hall, number.smaller.hall
    if larger is None or smaller is None or larger == smaller:
        return np.zeros(space.ndof)
    r, z = larger.radius_m - smaller.radius_m, larger.height_m - smaller.height_m
    scale = HALL_STEP / np.hypot(r, z)
    middle = 0.5 * (larger.radius_m + smaller.radius_m), 0.5 * (larger.height_m + smaller.height_m)
    ends = [
        hall_row(replace(larger, radius_m=abs(middle[0] + s * scale * r), height_m=middle[1] + s * scale * z), space)
        for s in (1.0, -1.0)
    ]
    return np.asarray((ends[0] - ends[1]) / (2.0 * scale * 2.0 * number.step))


def impedance_slopes(
    actuator: Actuator,
    numbers: Sequence[DrawnNumber],
    moving: MovingMesh,
    space: H1,
    distance: float,
    frequencies: FloatArray,
    fields: FieldArray,
) -> ComplexArray:
    """Slopes of the inductances per unit of each number in H, shape (numbers, f, n, n); nothing saturates.

    From fields (f, n, unknowns) of 1 A each. The mesh is as it was made, not stretched to the distance.
    """
    plain = [
        replace(number, larger=_unmagnetised(number.larger), smaller=_unmagnetised(number.smaller))
        for number in numbers
    ]
    held, count = np.zeros(moving.mesh.nv, dtype=np.bool_), fields.shape[1]
    slopes = ExplicitSlopes(space, _unmagnetised(actuator), moving, plain, held)
    first, second = np.triu_indices(count, 1)
    unit = np.eye(count)
    factors = np.concatenate([unit, unit[first] + unit[second]])
    result = np.zeros((len(numbers), len(frequencies), count, count), dtype=np.complex128)
    for k, field in enumerate(fields):
        samples = slopes.sample(field.real.T) + 1j * slopes.sample(field.imag.T)
        s = 2j * np.pi * frequencies[k]
        doubled = 2.0 * slopes.evaluate(samples @ factors.T, factors, distance - moving.reference, s).T
        result[:, k, range(count), range(count)] = doubled[:, :count]
        mutual = 0.5 * (doubled[:, count:] - doubled[:, first] - doubled[:, second])
        result[:, k, first, second] = result[:, k, second, first] = mutual
    return result


def _unmagnetised(actuator: Actuator) -> Actuator:
    """The actuator without what its magnets do by themselves; nothing of that is in a small-signal impedance."""

    def without(region: Region) -> Region:
        material = region.material
        plain = replace(material, remanence_T=0.0) if isinstance(material, LinearMaterial) else material
        return replace(region, material=plain)

    moving = replace(actuator.moving, regions=tuple(without(region) for region in actuator.moving.regions))
    return replace(actuator, fixed=tuple(without(region) for region in actuator.fixed), moving=moving)
