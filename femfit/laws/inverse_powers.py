"""A dictionary of inverse powers of the distance, 2 to 5, without a shift."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw


def _columns(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    inverse = 1.0 / distance
    square = inverse * inverse
    fourth = square * square
    return np.stack([square, square * inverse, fourth, fourth * inverse], axis=-1)


def _gradient(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    return np.stack([-k * distance ** (-k - 1.0) for k in (2.0, 3.0, 4.0, 5.0)], axis=-1)


def _potential(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    return np.stack([distance ** (1.0 - k) / (k - 1.0) for k in (2.0, 3.0, 4.0, 5.0)], axis=-1)


INVERSE_POWERS = ForceLaw(
    name="inverse-powers",
    formula="a d^-2 + b d^-3 + c d^-4 + e d^-5",
    basis=("d^-2", "d^-3", "d^-4", "d^-5"),
    coefficient_units=("N m^2", "N m^3", "N m^4", "N m^5"),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=5,
    reference="multipoles on the axis: J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 4.1",
)
