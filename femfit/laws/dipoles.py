"""Laws of inverse powers of the distance: of dipoles, of dipoles and coils, and of several multipoles.

One inverse power of the distance: c d^-4, as of two coaxial dipoles.

Two inverse powers of the distance: a d^-4, as of a magnet and its image, + b d^-2, as of a coil.

F1e with each distance counted from where its source seems to lie: a (d + d1)^-4 + b (d + d2)^-2.

Two coaxial dipole forces of different depth: a (d + d1)^-4 + b (d + d2)^-4.

The force between coaxial dipoles falls with the fourth power of their distance; a magnet is drawn to its image in the
core (d1, nearer) and to the coil (d2, deeper).

A dipole drawn to its image and to a pole face: a (d + d1)^-4 + b (d^2 + R^2)^(-3/2).

A uniformly charged disk (a pole face of radius R) has the field 1 - d / sqrt(d^2 + R^2) on its axis; the force on a
dipole is that field's gradient.

A dipole drawn to its image and to a current loop: a (d + d1)^-4 + b s (s^2 + R^2)^(-5/2), s = d + d2.

The loop's field on its axis is proportional to (s^2 + R^2)^(-3/2), and the force on a dipole to that field's gradient.

A dictionary of inverse powers of the distance, 2 to 5, without a shift.

A dictionary of inverse powers of a shifted distance, 2 to 5: one division serves all of them.

Three multipoles about one centre behind the face: inverse powers 4 to 6 of a shifted distance.

A shifted dipole and a rational bell: a (d + d1)^-4 + b (d^2 + R^2)^-2, without roots.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from femfit.laws.law import ForceLaw, ShapeParameter, law_of_powers

F2E = law_of_powers(
    name="F2e",
    formula="c d^-4",
    basis=("d^-4",),
    coefficient_units=("N m^4",),
    powers=((4, ""),),
    column_operations=3,
    reference="Chowdhury and Sarjas, Sensors 16 (2016) 1504, eq. (6)",
    nonnegative=(True,),
)


F1E = law_of_powers(
    name="F1e",
    formula="a d^-4 + b d^-2",
    basis=("d^-4", "d^-2"),
    coefficient_units=("N m^4", "N m^2"),
    powers=((4, ""), (2, "")),
    column_operations=3,
    reference="Chowdhury and Sarjas, Sensors 16 (2016) 1504, eq. (5)",
    nonnegative=(True, True),
)


SHIFTED_F1E = law_of_powers(
    name="shifted-F1e",
    formula="a (d + d1)^-4 + b (d + d2)^-2",
    basis=("(d+d1)^-4", "(d+d2)^-2"),
    coefficient_units=("N m^4", "N m^2"),
    powers=((4, "shift1_m"), (2, "shift2_m")),
    column_operations=7,
    reference="Chowdhury and Sarjas, Sensors 16 (2016) 1504, eq. (5), with shifted origins",
    shape=(
        ShapeParameter("shift1_m", 1e-5, 2e-3, "depth of the image that the magnet is drawn to"),
        ShapeParameter("shift2_m", 1e-5, 10e-3, "depth of the coil's pole"),
    ),
)


TWO_DIPOLES = law_of_powers(
    name="two-dipoles",
    formula="a (d + d1)^-4 + b (d + d2)^-4",
    basis=("(d+d1)^-4", "(d+d2)^-4"),
    coefficient_units=("N m^4", "N m^4"),
    powers=((4, "shift1_m"), (4, "shift2_m")),
    column_operations=8,
    reference="J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 5.7: force between dipoles",
    shape=(
        ShapeParameter("shift1_m", 1e-5, 2e-3, "depth of the nearer dipole"),
        ShapeParameter("shift2_m", 1e-5, 30e-3, "depth of the farther dipole"),
    ),
)


def _potential_of_dipole_disk(distance: Any, shape: Mapping[str, Any]) -> tuple[Any, ...]:
    radius = shape["radius_m"]
    root = np.sqrt(distance**2 + radius**2)
    disk = 1.0 / (root * (root + distance))  # (1 - d / root) / R^2 without its cancellation at large d
    return (distance + shape["shift_m"]) ** -3.0 / 3.0, disk


DIPOLE_DISK = ForceLaw(
    name="dipole-disk",
    formula="a (d + d1)^-4 + b (d^2 + R^2)^(-3/2)",
    basis=("(d+d1)^-4", "(d^2+R^2)^(-3/2)"),
    coefficient_units=("N m^4", "N m^3"),
    potentials=_potential_of_dipole_disk,
    column_operations=9,
    reference="J. D. Jackson, Classical Electrodynamics (Wiley, 1999), 1.6 (disk) and 5.7 (dipole)",
    shape=(
        ShapeParameter("shift_m", 1e-5, 2e-3, "depth of the magnet's image"),
        ShapeParameter("radius_m", 1e-3, 23e-3, "radius of the pole face"),
    ),
)


def _potential_of_dipole_loop(distance: Any, shape: Mapping[str, Any]) -> tuple[Any, ...]:
    image, loop = distance + shape["shift1_m"], distance + shape["shift2_m"]
    return image**-3.0 / 3.0, (loop**2 + shape["radius_m"] ** 2) ** -1.5 / 3.0


DIPOLE_LOOP = ForceLaw(
    name="dipole-loop",
    formula="a (d + d1)^-4 + b s (s^2 + R^2)^(-5/2), s = d + d2",
    basis=("(d+d1)^-4", "loop gradient"),
    coefficient_units=("N m^4", "N m^4"),
    potentials=_potential_of_dipole_loop,
    column_operations=12,
    reference="J. D. Jackson, Classical Electrodynamics (Wiley, 1999), 5.5 (loop) and 5.7 (dipole)",
    shape=(
        ShapeParameter("shift1_m", 1e-5, 2e-3, "depth of the magnet's image"),
        ShapeParameter("shift2_m", 1e-5, 10e-3, "depth of the loop behind the face"),
        ShapeParameter("radius_m", 1e-3, 25e-3, "radius of the loop"),
    ),
)


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
    shape=(ShapeParameter("shift_m", 1e-5, 5e-3, "depth of the expansion's centre behind the face"),),
)


SHIFTED_MULTIPOLES = law_of_powers(
    name="shifted-multipoles",
    formula="a s^-4 + b s^-5 + c s^-6, s = d + d1",
    basis=("s^-4", "s^-5", "s^-6"),
    coefficient_units=("N m^4", "N m^5", "N m^6"),
    powers=((4, "shift_m"), (5, "shift_m"), (6, "shift_m")),
    column_operations=6,
    reference="multipoles on the axis: J. D. Jackson, Classical Electrodynamics (Wiley, 1999), section 4.1",
    shape=(ShapeParameter("shift_m", 1e-5, 10e-3, "depth of the multipoles' centre behind the face"),),
)


def _potential_of_rational(distance: Any, shape: Mapping[str, Any]) -> tuple[Any, ...]:
    radius = shape["radius_m"]
    tail = 0.5 * np.pi - np.arctan(distance / radius) - radius * distance / (distance**2 + radius**2)
    return (distance + shape["shift_m"]) ** -3.0 / 3.0, tail / (2.0 * radius**3)


RATIONAL = ForceLaw(
    name="rational",
    formula="a (d + d1)^-4 + b (d^2 + R^2)^-2",
    basis=("(d+d1)^-4", "(d^2+R^2)^-2"),
    coefficient_units=("N m^4", "N m^4"),
    potentials=_potential_of_rational,
    column_operations=8,
    reference="I. S. Gradshteyn and I. M. Ryzhik, Table of Integrals (Academic Press, 2007), 2.103 (potential)",
    shape=(
        ShapeParameter("shift_m", 1e-5, 2e-3, "depth of the magnet's image"),
        ShapeParameter("radius_m", 1e-3, 33e-3, "half width of the bell"),
    ),
)
