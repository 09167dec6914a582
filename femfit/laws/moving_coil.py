"""A coil that moves in a magnet's field: Bl(d) i + L'(d) i^2 / 2 + a spring of steel and magnets, polynomials in d.

Each power of the distance carries a polynomial of the current: its constants make the force without current, its slopes
the motional constant Bl(d), and its squares the reluctance force, half of dL/dd.
"""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.laws.law import ForceLaw

HIGHEST = 6
"""Power of the distance: a coil that leaves its gap on both sides has a Bl(d) with a top and two bends."""


def _columns(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    powers = [np.ones_like(distance), distance]
    while len(powers) <= HIGHEST:
        powers.append(powers[-1] * distance)
    return np.stack(powers, axis=-1)


def _gradient(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    return np.stack([k * distance ** max(k - 1, 0) for k in range(HIGHEST + 1)], axis=-1)


def _potential(distance: FloatArray, _shape: Mapping[str, float]) -> FloatArray:
    return np.stack([-(distance ** (k + 1)) / (k + 1) for k in range(HIGHEST + 1)], axis=-1)


MOVING_COIL = ForceLaw(
    name="moving-coil",
    formula="sum_k c_k d^k, k = 0..6",
    basis=("1", "d", *(f"d^{k}" for k in range(2, HIGHEST + 1))),
    coefficient_units=("N", "N m^-1", *(f"N m^-{k}" for k in range(2, HIGHEST + 1))),
    columns=_columns,
    gradient_columns=_gradient,
    potential_columns=_potential,
    column_operations=HIGHEST - 1,
    reference="W. Klippel, J. Audio Eng. Soc. 54 (2006) 907, section 1 (Bl(x), L(x) and the reluctance force)",
    passes_face=True,
    decays=False,
)
