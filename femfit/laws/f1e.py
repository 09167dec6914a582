"""Two inverse powers of the distance: a d^-4, as of a magnet and its image, + b d^-2, as of a coil."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw


def _columns(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    inverse = 1.0 / distance
    square = inverse * inverse
    return np.stack([square * square, square], axis=-1)


def _gradient(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    return np.stack([-4.0 * distance**-5.0, -2.0 * distance**-3.0], axis=-1)


def _potential(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    return np.stack([distance**-3.0 / 3.0, 1.0 / distance], axis=-1)


F1E = ForceLaw(
    name="F1e",
    formula="a d^-4 + b d^-2",
    basis=("d^-4", "d^-2"),
    coefficient_units=("N m^4", "N m^2"),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=3,
    reference="Chowdhury and Sarjas, Sensors 16 (2016) 1504, eq. (5)",
    nonnegative=(True, True),
)
