"""Two decaying exponentials: a exp(-d / l1) + b exp(-d / l2)."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw, ShapeParameter


def _columns(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    rate1, rate2 = -1.0 / shape["length1_m"], -1.0 / shape["length2_m"]
    return np.stack([np.exp(rate1 * distance), np.exp(rate2 * distance)], axis=-1)


def _gradient(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    rate1, rate2 = -1.0 / shape["length1_m"], -1.0 / shape["length2_m"]
    return np.stack([rate1 * np.exp(rate1 * distance), rate2 * np.exp(rate2 * distance)], axis=-1)


def _potential(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    length1, length2 = shape["length1_m"], shape["length2_m"]
    return np.stack([length1 * np.exp(-distance / length1), length2 * np.exp(-distance / length2)], axis=-1)


TWO_EXPONENTIALS = ForceLaw(
    name="two-exponentials",
    formula="a exp(-d / l1) + b exp(-d / l2)",
    basis=("exp(-d/l1)", "exp(-d/l2)"),
    coefficient_units=("N", "N"),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=42,
    reference="H. A. Haus and J. R. Melcher, Electromagnetic Fields and Energy (Prentice Hall, 1989), 5.4",
    passes_face=True,
    shape=(
        ShapeParameter("length1_m", "m", 1e-4, 0.3, 4e-3, "decay length of the near part"),
        ShapeParameter("length2_m", "m", 1e-4, 0.3, 16e-3, "decay length of the far part"),
    ),
)
