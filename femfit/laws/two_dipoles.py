"""Two coaxial dipole forces of different depth: a (d + d1)^-4 + b (d + d2)^-4.

The force between coaxial dipoles falls with the fourth power of their distance; a magnet is drawn to its image in the
core (d1, nearer) and to the coil (d2, deeper).
"""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw, ShapeParameter


def _columns(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    first, second = distance + shape["shift1_m"], distance + shape["shift2_m"]
    square1, square2 = 1.0 / (first * first), 1.0 / (second * second)
    return np.stack([square1 * square1, square2 * square2], axis=-1)


def _gradient(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    first, second = distance + shape["shift1_m"], distance + shape["shift2_m"]
    return np.stack([-4.0 * first**-5.0, -4.0 * second**-5.0], axis=-1)


def _potential(distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    first, second = distance + shape["shift1_m"], distance + shape["shift2_m"]
    return np.stack([first**-3.0 / 3.0, second**-3.0 / 3.0], axis=-1)


TWO_DIPOLES = ForceLaw(
    name="two-dipoles",
    formula="a (d + d1)^-4 + b (d + d2)^-4",
    basis=("(d+d1)^-4", "(d+d2)^-4"),
    coefficient_units=("N m^4", "N m^4"),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=8,
    reference="J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 5.7: force between dipoles",
    shape=(
        ShapeParameter("shift1_m", "m", 1e-5, 0.3, 2e-3, "depth of the nearer dipole"),
        ShapeParameter("shift2_m", "m", 1e-5, 0.3, 30e-3, "depth of the farther dipole"),
    ),
)
