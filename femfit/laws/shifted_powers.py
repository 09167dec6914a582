"""A dictionary of inverse powers of a shifted distance, 2 to 5: one division serves all of them."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw, ShapeParameter


def _columns(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    inverse = 1.0 / (distance + shape["shift_m"])
    square = inverse * inverse
    fourth = square * square
    return np.stack([square, square * inverse, fourth, fourth * inverse], axis=-1)


def _gradient(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    shifted = distance + shape["shift_m"]
    return np.stack([-k * shifted ** (-k - 1.0) for k in (2.0, 3.0, 4.0, 5.0)], axis=-1)


def _potential(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    shifted = distance + shape["shift_m"]
    return np.stack([shifted ** (1.0 - k) / (k - 1.0) for k in (2.0, 3.0, 4.0, 5.0)], axis=-1)


SHIFTED_POWERS = ForceLaw(
    name="shifted-powers",
    formula="a s^-2 + b s^-3 + c s^-4 + e s^-5, s = d + d1",
    basis=("s^-2", "s^-3", "s^-4", "s^-5"),
    coefficient_units=("N m^2", "N m^3", "N m^4", "N m^5"),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=6,
    reference="multipoles on the axis: J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 4.1",
    shape=(ShapeParameter("shift_m", "m", 1e-5, 0.3, 5e-3, "depth of the expansion's centre behind the face"),),
)
