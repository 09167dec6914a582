"""F1e with each distance counted from where its source seems to lie: a (d + d1)^-4 + b (d + d2)^-2."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw, ShapeParameter


def _columns(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    first, second = distance + shape["shift1_m"], distance + shape["shift2_m"]
    square = 1.0 / (first * first)
    return np.stack([square * square, 1.0 / (second * second)], axis=-1)


def _gradient(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    first, second = distance + shape["shift1_m"], distance + shape["shift2_m"]
    return np.stack([-4.0 * first**-5.0, -2.0 * second**-3.0], axis=-1)


def _potential(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    first, second = distance + shape["shift1_m"], distance + shape["shift2_m"]
    return np.stack([first**-3.0 / 3.0, 1.0 / second], axis=-1)


SHIFTED_F1E = ForceLaw(
    name="shifted-F1e",
    formula="a (d + d1)^-4 + b (d + d2)^-2",
    basis=("(d+d1)^-4", "(d+d2)^-2"),
    coefficient_units=("N m^4", "N m^2"),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=7,
    reference="Chowdhury and Sarjas, Sensors 16 (2016) 1504, eq. (5), with shifted origins",
    shape=(
        ShapeParameter("shift1_m", "m", 1e-5, 0.3, 2e-3, "depth of the image that the magnet is drawn to"),
        ShapeParameter("shift2_m", "m", 1e-5, 0.3, 10e-3, "depth of the coil's pole"),
    ),
)
