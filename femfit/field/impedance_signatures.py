r"""What the numbers of a drawing change of the inductances at a complex frequency: slopes of L(s), Z = R + s L.

With w_k of 1 A in circuit k, (K + s M) w_k = load_k, 2 G = sum of i_j i_k L_jk(s) is stationary in w, so that

    dL_jk/dp = w_k . d(load_j)/dp + w_j . d(load_k)/dp - w_j^T (dK/dp + s dM/dp) w_k,

the explicit slope of :mod:`femfit.field.explicit_slopes` at the solved fields: no further solution, whatever the
number of numbers.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from ngsolve import H1

from femfit.core.arrays import ComplexArray, FloatArray
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.parts import Actuator, LinearMaterial, Region
from femfit.field.explicit_slopes import ExplicitSlopes
from femfit.field.harmonic import FieldArray
from femfit.field.moving_mesh import MovingMesh


class ImpedanceSignatures:
    """Slopes of the inductances on one mesh and space; nothing saturates."""

    def __init__(self, actuator: Actuator, numbers: Sequence[DrawnNumber], moving: MovingMesh, space: H1) -> None:
        plain = [replace(one, larger=_unmagnetised(one.larger), smaller=_unmagnetised(one.smaller)) for one in numbers]
        held = np.zeros(moving.mesh.nv, dtype=np.bool_)
        self._moving = moving
        self._slopes = ExplicitSlopes(
            space, _unmagnetised(actuator), moving.reference, plain, moving.vertex_share, held
        )

    def at(self, distance: float, frequencies: FloatArray, fields: FieldArray) -> ComplexArray:
        """Slopes per unit of each number in H, shape (numbers, f, n, n), from fields (f, n, unknowns) of 1 A each.

        The mesh is as it was made, not stretched to the distance.
        """
        stretch = distance - self._moving.reference
        return np.stack(
            [self._of(2j * np.pi * one, stretch, own) for one, own in zip(frequencies, fields, strict=True)], axis=1
        )

    def _of(self, s: complex, stretch: float, fields: FieldArray) -> ComplexArray:
        samples = self._slopes.sample(fields.real.T) + 1j * self._slopes.sample(fields.imag.T)
        count = len(fields)
        first, second = np.triu_indices(count, 1)
        unit = np.eye(count)
        factors = np.concatenate([unit, unit[first] + unit[second]])
        doubled = 2.0 * self._slopes.evaluate(samples @ factors.T, factors, stretch, s).T
        result = np.zeros((len(doubled), count, count), dtype=np.complex128)
        result[:, range(count), range(count)] = doubled[:, :count]
        mutual = 0.5 * (doubled[:, count:] - doubled[:, first] - doubled[:, second])
        result[:, first, second] = result[:, second, first] = mutual
        return result


def _unmagnetised(actuator: Actuator) -> Actuator:
    """The actuator without what its magnets do by themselves; nothing of that is in a small-signal impedance."""

    def without(region: Region) -> Region:
        material = region.material
        plain = replace(material, remanence_T=0.0) if isinstance(material, LinearMaterial) else material
        return replace(region, material=plain)

    moving = replace(actuator.moving, regions=tuple(without(one) for one in actuator.moving.regions))
    return replace(actuator, fixed=tuple(without(one) for one in actuator.fixed), moving=moving)
