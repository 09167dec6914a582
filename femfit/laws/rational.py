"""A shifted dipole and a rational bell: a (d + d1)^-4 + b (d^2 + R^2)^-2, without roots."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw, ShapeParameter


def _columns(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    image = distance + shape["shift_m"]
    square = 1.0 / (image * image)
    bell = 1.0 / (distance * distance + shape["radius_m"] ** 2)
    return np.stack([square * square, bell * bell], axis=-1)


def _gradient(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    bell = 1.0 / (distance**2 + shape["radius_m"] ** 2)
    return np.stack([-4.0 * (distance + shape["shift_m"]) ** -5.0, -4.0 * distance * bell**3], axis=-1)


def _potential(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    radius = shape["radius_m"]
    tail = np.arctan2(radius, distance) - radius * distance / (distance**2 + radius**2)
    return np.stack([(distance + shape["shift_m"]) ** -3.0 / 3.0, tail / (2.0 * radius**3)], axis=-1)


RATIONAL = ForceLaw(
    name="rational",
    formula="a (d + d1)^-4 + b (d^2 + R^2)^-2",
    basis=("(d+d1)^-4", "(d^2+R^2)^-2"),
    coefficient_units=("N m^4", "N m^4"),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=8,
    reference="I. S. Gradshteyn and I. M. Ryzhik, Table of Integrals (Academic Press, 2007), 2.103 (potential)",
    shape=(
        ShapeParameter("shift_m", "m", 1e-5, 0.3, 2e-3, "depth of the magnet's image"),
        ShapeParameter("radius_m", "m", 1e-3, 0.3, 33e-3, "half width of the bell"),
    ),
)
