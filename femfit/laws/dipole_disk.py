"""A dipole drawn to its image and to a pole face: a (d + d1)^-4 + b (d^2 + R^2)^(-3/2).

A uniformly charged disk (a pole face of radius R) has the field 1 - d / sqrt(d^2 + R^2) on its axis; the force on a
dipole is that field's gradient.
"""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw, ShapeParameter


def _columns(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    image = distance + shape["shift_m"]
    square = 1.0 / (image * image)
    inverse = 1.0 / (distance * distance + shape["radius_m"] ** 2)
    return np.stack([square * square, inverse * np.sqrt(inverse)], axis=-1)


def _gradient(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    square_sum = distance**2 + shape["radius_m"] ** 2
    return np.stack([-4.0 * (distance + shape["shift_m"]) ** -5.0, -3.0 * distance * square_sum**-2.5], axis=-1)


def _potential(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    radius = shape["radius_m"]
    root = np.sqrt(distance**2 + radius**2)
    disk = 1.0 / (root * (root + distance))  # (1 - d / root) / R^2 without its cancellation at large d
    return np.stack([(distance + shape["shift_m"]) ** -3.0 / 3.0, disk], axis=-1)


DIPOLE_DISK = ForceLaw(
    name="dipole-disk",
    formula="a (d + d1)^-4 + b (d^2 + R^2)^(-3/2)",
    basis=("(d+d1)^-4", "(d^2+R^2)^(-3/2)"),
    coefficient_units=("N m^4", "N m^3"),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=9,
    reference="J. D. Jackson, Classical Electrodynamics (Wiley, 1999), 1.6 (disk) and 5.7 (dipole)",
    shape=(
        ShapeParameter("shift_m", "m", 1e-5, 0.3, 2e-3, "depth of the magnet's image"),
        ShapeParameter("radius_m", "m", 1e-3, 0.3, 23e-3, "radius of the pole face"),
    ),
)
