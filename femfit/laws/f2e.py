"""One inverse power of the distance: c d^-4, as of two coaxial dipoles."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw


def _columns(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    square = 1.0 / (distance * distance)
    return np.stack([square * square], axis=-1)


def _gradient(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    return np.stack([-4.0 * distance**-5.0], axis=-1)


def _potential(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    return np.stack([distance**-3.0 / 3.0], axis=-1)


F2E = ForceLaw(
    name="F2e",
    formula="c d^-4",
    basis=("d^-4",),
    coefficient_units=("N m^4",),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=3,
    reference="Chowdhury and Sarjas, Sensors 16 (2016) 1504, eq. (6)",
    nonnegative=(True,),
)
