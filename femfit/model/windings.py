"""All windings of a model: its circuits, and the patterns of its eddy currents as windings that are short-circuited.

The equations of motion know no other: L w' = U - R w + k_m v for the currents w = (i, e), where U is 0 for a pattern.

How far currents get within a step: the decay L i' = -R i, exactly.

Of i' = r - L^-1 R (i - i_0) with r the rate at the step's beginning, a step of h ends at i_0 + h f1(M) r and has the
mean i_0 + h f2(M) r, with M = h L^-1 R, f1(z) = (1 - exp(-z)) / z and f2(z) = (1 - f1(z)) / z. Of several circuits M
has the real modes of R^(-1/2) (h R^(1/2) L^-1 R^(1/2)) R^(1/2), whose middle is symmetric.

References
----------
M. Hochbruck and A. Ostermann, Acta Numerica 19 (2010) 209, eqs. (2.3) to (2.5), with f1(z) = phi_1(-z).
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.model.magnetics import Magnetics

if TYPE_CHECKING:
    from femfit.model.tabulated_step import StepTable


@dataclass(frozen=True, eq=False)
class Windings:
    """The n circuits, and after them the r patterns."""

    magnetics: Magnetics  # Of all their currents
    resistances_ohm: FloatArray  # Shape (n + r,)
    series_H: FloatArray  # In series outside of the field, on the diagonal of shape (n + r, n + r)
    circuits: int  # n
    # By the length of a step, as :func:`femfit.model.tabulated_step.step_table` makes them
    step_tables: "dict[float, StepTable | None]" = field(default_factory=dict, init=False, repr=False)

    @property
    def count(self) -> int:
        """How many there are, n + r."""
        return len(self.resistances_ohm)

    @property
    def end(self) -> int:
        """Place behind the currents in a state (distance, velocity, currents, ..)."""
        return 2 + len(self.resistances_ohm)

    def voltages(self, voltage: FloatArray) -> FloatArray:
        """Voltages (..., n + r) of all windings from those of the circuits, (..., n)."""
        if self.count == self.circuits:
            return voltage
        result = np.zeros((*voltage.shape[:-1], self.count))
        result[..., : self.circuits] = voltage
        return result


def solved(inductance: FloatArray, right: FloatArray) -> FloatArray:
    """L^-1 b; of one circuit by a division, which is quicker than a factorisation."""
    if inductance.shape[-1] == 1:
        return right / inductance
    return np.asarray(np.linalg.solve(inductance, right))


LEAST_DECAY = 1e-6
"""Numerical: smaller products of step and R/L, and those of a co-energy that is extended to a negative inductance, are
taken as this: 5e-7 of the current's change, while f2 keeps ten digits."""

ALIKE = 1e-4
"""Numerical: modes closer than this share the derivative between them, which is off by the square of it."""


def decay_shares(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(f1, f2) of products of step and decay rate, of any shape."""
    z = np.maximum(z, LEAST_DECAY)
    first = -np.expm1(-z) / z
    return first, (1.0 - first) / z


@dataclass(frozen=True, eq=False)
class Decay:
    """A step's decay of n circuits at many points, by its modes."""

    z: FloatArray  # Step times decay rate of each mode, (..., n)
    modes: FloatArray  # W = R^(-1/2) U, (..., n, n): M = W z W^T R
    resistances: FloatArray  # (n,), or (..., n)

    def parts(self, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """f1(M) r and f2(M) r of rates (..., n)."""
        first, second = decay_shares(self.z)
        if self.resistances.shape[-1] == 1:
            return first * rate, second * rate
        along = self._along(rate)
        return self._back(first * along), self._back(second * along)

    def slopes(self, rate: FloatArray, inductance: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
        """How changes dL (..., n, n, m) of the inductance change f1(M) r and f2(M) r, each (..., n, m)."""
        z, modes = np.maximum(self.z, LEAST_DECAY), self.modes
        first, second = decay_shares(z)
        third = (0.5 - second) / z
        if self.resistances.shape[-1] == 1:
            change = -(z * z / (step * self.resistances) * rate)[..., None] * inductance[..., 0, :]
            return (second - first)[..., None] * change, (2.0 * third - second)[..., None] * change
        changed = np.einsum("...ja,...jkm,...kb->...abm", modes, inductance, modes)
        changed = -changed * (z[..., :, None] * z[..., None, :])[..., None] / step
        along = self._along(rate)
        results = []
        for share, slope in ((first, second - first), (second, 2.0 * third - second)):
            apart = z[..., :, None] - z[..., None, :]
            alike = np.abs(apart) < ALIKE
            quotient = (share[..., :, None] - share[..., None, :]) / np.where(alike, 1.0, apart)
            between = np.where(alike, 0.5 * (slope[..., :, None] + slope[..., None, :]), quotient)
            results.append(np.einsum("...ja,...ab,...abm,...b->...jm", modes, between, changed, along))
        return results[0], results[1]

    def applied(self, matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
        """f1(M) A and f2(M) A of matrices (..., n, m)."""
        first, second = decay_shares(self.z)
        if self.resistances.shape[-1] == 1:
            return first[..., None] * matrix, second[..., None] * matrix
        along = np.swapaxes(self.modes, -1, -2) @ (self.resistances[..., None] * matrix)
        return self.modes @ (first[..., None] * along), self.modes @ (second[..., None] * along)

    def _along(self, rate: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("...ja,...j->...a", self.modes, self.resistances * rate))

    def _back(self, along: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("...ja,...a->...j", self.modes, along))


def decay_of(inductance: FloatArray, resistances: FloatArray, step: FloatArray | float) -> Decay:
    """The decay of circuits with inductances (..., n, n) in H, those in series included.

    Parameters
    ----------
    resistances : array, shape (n,), or (..., n) as they are at each point
        In ohm.
    """
    root = np.sqrt(resistances)
    if resistances.shape[-1] == 1:
        z = step * resistances / inductance[..., 0]
        return Decay(z, np.broadcast_to(1.0 / root[..., None], inductance.shape), resistances)
    times = inductance / (root[..., :, None] * root[..., None, :])
    finite = np.isfinite(times).all(axis=(-2, -1))[..., None, None]
    times, modes = np.linalg.eigh(np.where(finite, times, np.eye(root.shape[-1])))  # a lost run has no modes, no state
    return Decay(step / np.where(times == 0.0, -1.0, times), modes / root[..., :, None], resistances)
