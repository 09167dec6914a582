"""A dictionary of inverse powers of the distance, 2 to 5, without a shift.

A dictionary of inverse powers of a shifted distance, 2 to 5: one division serves all of them.

Three multipoles about one centre behind the face: inverse powers 4 to 6 of a shifted distance.

A shifted dipole and a rational bell: a (d + d1)^-4 + b (d^2 + R^2)^-2, without roots.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from femfit.laws.law import ForceLaw, ShapeParameter, law_of_powers

INVERSE_POWERS = law_of_powers(
    name="inverse-powers",
    formula="a d^-2 + b d^-3 + c d^-4 + e d^-5",
    basis=("d^-2", "d^-3", "d^-4", "d^-5"),
    coefficient_units=("N m^2", "N m^3", "N m^4", "N m^5"),
    powers=((2, ""), (3, ""), (4, ""), (5, "")),
    column_operations=5,
    reference="multipoles on the axis: J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 4.1",
)


SHIFTED_POWERS = law_of_powers(
    name="shifted-powers",
    formula="a s^-2 + b s^-3 + c s^-4 + e s^-5, s = d + d1",
    basis=("s^-2", "s^-3", "s^-4", "s^-5"),
    coefficient_units=("N m^2", "N m^3", "N m^4", "N m^5"),
    powers=((2, "shift_m"), (3, "shift_m"), (4, "shift_m"), (5, "shift_m")),
    column_operations=6,
    reference="multipoles on the axis: J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 4.1",
    shape=(ShapeParameter("shift_m", "m", 1e-5, 0.3, 5e-3, "depth of the expansion's centre behind the face"),),
)


SHIFTED_MULTIPOLES = law_of_powers(
    name="shifted-multipoles",
    formula="a s^-4 + b s^-5 + c s^-6, s = d + d1",
    basis=("s^-4", "s^-5", "s^-6"),
    coefficient_units=("N m^4", "N m^5", "N m^6"),
    powers=((4, "shift_m"), (5, "shift_m"), (6, "shift_m")),
    column_operations=6,
    reference="multipoles on the axis: J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 4.1",
    shape=(ShapeParameter("shift_m", "m", 1e-5, 0.3, 10e-3, "depth of the multipoles' centre behind the face"),),
)


def _columns_of_rational(distance: Any, shape: Mapping[str, Any]) -> tuple[Any, ...]:
    image = distance + shape["shift_m"]
    square = 1.0 / (image * image)
    bell = 1.0 / (distance * distance + shape["radius_m"] ** 2)
    return square * square, bell * bell


def _potential_of_rational(distance: Any, shape: Mapping[str, Any]) -> tuple[Any, ...]:
    radius = shape["radius_m"]
    tail = np.arctan2(radius, distance) - radius * distance / (distance**2 + radius**2)
    return (distance + shape["shift_m"]) ** -3.0 / 3.0, tail / (2.0 * radius**3)


RATIONAL = ForceLaw(
    name="rational",
    formula="a (d + d1)^-4 + b (d^2 + R^2)^-2",
    basis=("(d+d1)^-4", "(d^2+R^2)^-2"),
    coefficient_units=("N m^4", "N m^4"),
    terms=_columns_of_rational,
    potentials=_potential_of_rational,
    column_operations=8,
    reference="I. S. Gradshteyn and I. M. Ryzhik, Table of Integrals (Academic Press, 2007), 2.103 (potential)",
    shape=(
        ShapeParameter("shift_m", "m", 1e-5, 0.3, 2e-3, "depth of the magnet's image"),
        ShapeParameter("radius_m", "m", 1e-3, 0.3, 33e-3, "half width of the bell"),
    ),
)
