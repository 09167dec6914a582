"""Three harmonics of one decay length: a e + b e^2 + c e^4 with e = exp(-d / l), one exponential in all.

Two decaying exponentials: a exp(-d / l1) + b exp(-d / l2).

A coil that moves in a magnet's field: Bl(d) i + L'(d) i^2 / 2 + a spring of steel and magnets, polynomials in d.

Each power of the distance carries a polynomial of the current: its constants make the force without current, its slopes
the motional constant Bl(d), and its squares the reluctance force, half of dL/dd.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from femfit.laws.law import ForceLaw, ShapeParameter


def _potential(distance: Any, shape: Mapping[str, Any]) -> tuple[Any, ...]:
    length = shape["length_m"]
    return tuple(length / k * np.exp(-k / length * distance) for k in (1.0, 2.0, 4.0))


EXPONENTIAL_HARMONICS = ForceLaw(
    name="exponential-harmonics",
    formula="a e + b e^2 + c e^4, e = exp(-d / l)",
    basis=("e", "e^2", "e^4"),
    coefficient_units=("N", "N", "N"),
    potentials=_potential,
    column_operations=23,
    reference="H. A. Haus and J. R. Melcher, Electromagnetic Fields and Energy (Prentice Hall, 1989), 5.4",
    passes_face=True,
    shape=(ShapeParameter("length_m", 1e-4, 16e-3, "decay length of the first harmonic"),),
)


def _potential_of_two_exponentials(distance: Any, shape: Mapping[str, Any]) -> tuple[Any, ...]:
    length1, length2 = shape["length1_m"], shape["length2_m"]
    return length1 * np.exp(-distance / length1), length2 * np.exp(-distance / length2)


TWO_EXPONENTIALS = ForceLaw(
    name="two-exponentials",
    formula="a exp(-d / l1) + b exp(-d / l2)",
    basis=("exp(-d/l1)", "exp(-d/l2)"),
    coefficient_units=("N", "N"),
    potentials=_potential_of_two_exponentials,
    column_operations=42,
    reference="H. A. Haus and J. R. Melcher, Electromagnetic Fields and Energy (Prentice Hall, 1989), 5.4",
    passes_face=True,
    shape=(
        ShapeParameter("length1_m", 1e-4, 4e-3, "decay length of the near part"),
        ShapeParameter("length2_m", 1e-4, 16e-3, "decay length of the far part"),
    ),
)


HIGHEST = 6
"""Power of the distance: a coil that leaves its gap on both sides has a Bl(d) with a top and two bends."""


def _potential_of_moving_coil(distance: Any, _shape: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(-(distance ** (k + 1)) / (k + 1) for k in range(HIGHEST + 1))


MOVING_COIL = ForceLaw(
    name="moving-coil",
    formula="sum_k c_k d^k, k = 0..6",
    basis=("1", "d", *(f"d^{k}" for k in range(2, HIGHEST + 1))),
    coefficient_units=("N", "N m^-1", *(f"N m^-{k}" for k in range(2, HIGHEST + 1))),
    potentials=_potential_of_moving_coil,
    column_operations=HIGHEST - 1,
    reference="W. Klippel, J. Audio Eng. Soc. 54 (2006) 907, section 1 (Bl(x), L(x) and the reluctance force)",
    passes_face=True,
)
