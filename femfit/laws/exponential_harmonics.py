"""Three harmonics of one decay length: a e + b e^2 + c e^4 with e = exp(-d / l), one exponential in all."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw, ShapeParameter


def _columns(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    first = np.exp(-1.0 / shape["length_m"] * distance)
    second = first * first
    return np.stack([first, second, second * second], axis=-1)


def _gradient(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    length = shape["length_m"]
    return np.stack([-k / length * np.exp(-k / length * distance) for k in (1.0, 2.0, 4.0)], axis=-1)


def _potential(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    length = shape["length_m"]
    return np.stack([length / k * np.exp(-k / length * distance) for k in (1.0, 2.0, 4.0)], axis=-1)


EXPONENTIAL_HARMONICS = ForceLaw(
    name="exponential-harmonics",
    formula="a e + b e^2 + c e^4, e = exp(-d / l)",
    basis=("e", "e^2", "e^4"),
    coefficient_units=("N", "N", "N"),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=23,
    reference="H. A. Haus and J. R. Melcher, Electromagnetic Fields and Energy (Prentice Hall, 1989), 5.4",
    passes_face=True,
    shape=(ShapeParameter("length_m", "m", 1e-4, 0.3, 16e-3, "decay length of the first harmonic"),),
)
