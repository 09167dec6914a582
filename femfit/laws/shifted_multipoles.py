"""Three multipoles about one centre behind the face: inverse powers 4 to 6 of a shifted distance."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw, ShapeParameter


def _columns(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    inverse = 1.0 / (distance + shape["shift_m"])
    square = inverse * inverse
    fourth = square * square
    return np.stack([fourth, fourth * inverse, fourth * square], axis=-1)


def _gradient(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    shifted = distance + shape["shift_m"]
    return np.stack([-k * shifted ** (-k - 1.0) for k in (4.0, 5.0, 6.0)], axis=-1)


def _potential(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    shifted = distance + shape["shift_m"]
    return np.stack([shifted ** (1.0 - k) / (k - 1.0) for k in (4.0, 5.0, 6.0)], axis=-1)


SHIFTED_MULTIPOLES = ForceLaw(
    name="shifted-multipoles",
    formula="a s^-4 + b s^-5 + c s^-6, s = d + d1",
    basis=("s^-4", "s^-5", "s^-6"),
    coefficient_units=("N m^4", "N m^5", "N m^6"),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=6,
    reference="multipoles on the axis: J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 4.1",
    shape=(ShapeParameter("shift_m", "m", 1e-5, 0.3, 10e-3, "depth of the multipoles' centre behind the face"),),
)
