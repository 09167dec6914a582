"""A dipole drawn to its image and to a current loop: a (d + d1)^-4 + b s (s^2 + R^2)^(-5/2), s = d + d2.

The loop's field on its axis is proportional to (s^2 + R^2)^(-3/2), and the force on a dipole to that field's gradient.
"""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw, ShapeParameter


def _columns(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    image, loop = distance + shape["shift1_m"], distance + shape["shift2_m"]
    square = 1.0 / (image * image)
    inverse = 1.0 / (loop * loop + shape["radius_m"] ** 2)
    return np.stack([square * square, loop * inverse * inverse * np.sqrt(inverse)], axis=-1)


def _gradient(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    image, loop = distance + shape["shift1_m"], distance + shape["shift2_m"]
    square_sum = loop**2 + shape["radius_m"] ** 2
    return np.stack([-4.0 * image**-5.0, square_sum**-2.5 - 5.0 * loop**2 * square_sum**-3.5], axis=-1)


def _potential(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    image, loop = distance + shape["shift1_m"], distance + shape["shift2_m"]
    return np.stack([image**-3.0 / 3.0, (loop**2 + shape["radius_m"] ** 2) ** -1.5 / 3.0], axis=-1)


DIPOLE_LOOP = ForceLaw(
    name="dipole-loop",
    formula="a (d + d1)^-4 + b s (s^2 + R^2)^(-5/2), s = d + d2",
    basis=("(d+d1)^-4", "loop gradient"),
    coefficient_units=("N m^4", "N m^4"),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=12,
    reference="J. D. Jackson, Classical Electrodynamics (Wiley, 1999), 5.5 (loop) and 5.7 (dipole)",
    shape=(
        ShapeParameter("shift1_m", "m", 1e-5, 0.3, 2e-3, "depth of the magnet's image"),
        ShapeParameter("shift2_m", "m", 1e-5, 0.3, 10e-3, "depth of the loop behind the face"),
        ShapeParameter("radius_m", "m", 1e-3, 0.3, 25e-3, "radius of the loop"),
    ),
)
