"""One inverse power of the distance: c d^-4, as of two coaxial dipoles.

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
        ShapeParameter("shift1_m", "m", 1e-5, 0.3, 2e-3, "depth of the image that the magnet is drawn to"),
        ShapeParameter("shift2_m", "m", 1e-5, 0.3, 10e-3, "depth of the coil's pole"),
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
        ShapeParameter("shift1_m", "m", 1e-5, 0.3, 2e-3, "depth of the nearer dipole"),
        ShapeParameter("shift2_m", "m", 1e-5, 0.3, 30e-3, "depth of the farther dipole"),
    ),
)


def _columns_of_dipole_disk(distance: Any, shape: Mapping[str, Any]) -> tuple[Any, ...]:
    image = distance + shape["shift_m"]
    square = 1.0 / (image * image)
    inverse = 1.0 / (distance * distance + shape["radius_m"] ** 2)
    return square * square, inverse * np.sqrt(inverse)


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
    terms=_columns_of_dipole_disk,
    potentials=_potential_of_dipole_disk,
    column_operations=9,
    reference="J. D. Jackson, Classical Electrodynamics (Wiley, 1999), 1.6 (disk) and 5.7 (dipole)",
    shape=(
        ShapeParameter("shift_m", "m", 1e-5, 0.3, 2e-3, "depth of the magnet's image"),
        ShapeParameter("radius_m", "m", 1e-3, 0.3, 23e-3, "radius of the pole face"),
    ),
)


def _columns_of_dipole_loop(distance: Any, shape: Mapping[str, Any]) -> tuple[Any, ...]:
    image, loop = distance + shape["shift1_m"], distance + shape["shift2_m"]
    square = 1.0 / (image * image)
    inverse = 1.0 / (loop * loop + shape["radius_m"] ** 2)
    return square * square, loop * inverse * inverse * np.sqrt(inverse)


def _potential_of_dipole_loop(distance: Any, shape: Mapping[str, Any]) -> tuple[Any, ...]:
    image, loop = distance + shape["shift1_m"], distance + shape["shift2_m"]
    return image**-3.0 / 3.0, (loop**2 + shape["radius_m"] ** 2) ** -1.5 / 3.0


DIPOLE_LOOP = ForceLaw(
    name="dipole-loop",
    formula="a (d + d1)^-4 + b s (s^2 + R^2)^(-5/2), s = d + d2",
    basis=("(d+d1)^-4", "loop gradient"),
    coefficient_units=("N m^4", "N m^4"),
    terms=_columns_of_dipole_loop,
    potentials=_potential_of_dipole_loop,
    column_operations=12,
    reference="J. D. Jackson, Classical Electrodynamics (Wiley, 1999), 5.5 (loop) and 5.7 (dipole)",
    shape=(
        ShapeParameter("shift1_m", "m", 1e-5, 0.3, 2e-3, "depth of the magnet's image"),
        ShapeParameter("shift2_m", "m", 1e-5, 0.3, 10e-3, "depth of the loop behind the face"),
        ShapeParameter("radius_m", "m", 1e-3, 0.3, 25e-3, "radius of the loop"),
    ),
)
