"""An effect with its columns for given readings, and amplitudes from which a fit starts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy import optimize

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.core.ties import first_best
from femfit.effects.effect import AddedEffect, Effect
from femfit.identify.noise.whitening import Whitening
from femfit.identify.readings.observations import Observations
from femfit.identify.signatures.columns import EffectColumns, effect_columns


@dataclass(frozen=True, eq=False)
class Start:
    """An effect as first-order columns, with amplitudes."""

    columns: EffectColumns  # In the readings' units, at given nonlinear parameters
    whitened: FloatArray  # The same with the noise whitened; shape (M, k)
    amplitude: FloatArray  # Counted from null; shape (k,)
    fall: float = 0.0  # By how much the amplitudes lower the weighted sum of squares to first order

    @classmethod
    def at_null(cls, columns: EffectColumns, whitening: Whitening) -> Self:
        """The start without any of the effect."""
        return cls(columns, whitening.full(columns.columns), np.zeros(len(columns.amplitudes)))

    @classmethod
    def all_at_null(cls, every: Sequence[EffectColumns], whitening: Whitening) -> tuple[Self, ...]:
        """The starts of many effects, whitened at once, which is several times faster."""
        if not every:
            return ()
        whitened = whitening.full(np.concatenate([one.columns for one in every], axis=1))
        parts = np.split(whitened, np.cumsum([one.columns.shape[1] for one in every])[:-1], axis=1)
        return tuple(cls(one, part, np.zeros(part.shape[1])) for one, part in zip(every, parts, strict=True))

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.columns.effect.name

    @property
    def count(self) -> int:
        """Number of amplitudes."""
        return len(self.columns.amplitudes)

    def part(self, picked: Sequence[int]) -> "Start":
        """The start with some of its amplitudes alone."""
        columns = replace(
            self.columns,
            amplitudes=tuple(self.columns.amplitudes[k] for k in picked),
            columns=self.columns.columns[:, picked],
        )
        return replace(self, columns=columns, whitened=self.whitened[:, picked], amplitude=self.amplitude[picked])

    def continued(self, added: AddedEffect) -> "Start":
        """The start at the parameters where a fit ended."""
        nonlinear = {p.name: added.parameters[p.name] for p in added.effect.parameters if p.nonlinear}
        amplitude = np.array([added.parameters[p.name] - p.null for p in self.columns.amplitudes])
        return replace(self, columns=replace(self.columns, shape=nonlinear), amplitude=amplitude)


def starting_point(
    observations: Observations, whitening: Whitening, effects: Sequence[Effect], at_null: bool = False
) -> list[Start]:
    """Amplitudes of effects to first order, bounded, with the nonlinear parameters that fit best."""
    target = whitening.full(observations.residual)
    chosen: list[Start] = []
    for effect in effects:
        variants = [Start.at_null(one, whitening) for one in effect_columns(effect, observations)]
        if not variants:
            raise TableError(
                f"Effect {effect.name} changes no reading at these settings, so it cannot be fitted to them. "
                f"{effect.experiment}"
            )
        tries = [fitted_together(target, [*chosen, one]) for one in variants]
        chosen = tries[first_best([fall for _, fall in tries])][0]
    return [replace(one, amplitude=np.zeros(one.count)) for one in chosen] if at_null else chosen


def fitted_together(target: FloatArray, starts: Sequence[Start]) -> tuple[list[Start], float]:
    """Starts with the bounded amplitudes that together fit a whitened target best, and the fall of its square."""
    columns = np.concatenate([one.whitened for one in starts], axis=1)
    amplitude, fall = bounded_amplitudes(
        target, columns, np.concatenate([one.columns.bounds for one in starts], axis=1)
    )
    parts = np.split(amplitude, np.cumsum([one.count for one in starts])[:-1])
    return [replace(one, amplitude=part) for one, part in zip(starts, parts, strict=True)], fall


def bounded_amplitudes(target: FloatArray, columns: FloatArray, bounds: FloatArray) -> tuple[FloatArray, float]:
    """Bounded linear least squares in few unknowns.

    Parameters
    ----------
    target : array, shape (M,)
        Whitened residual, or its projection onto the columns' space.
    columns : array, shape (M, k)
        Whitened.
    bounds : array, shape (2, k)
        Lower and upper.

    Returns
    -------
    tuple of (array of shape (k,), float)
        Amplitudes, and by how much they lower the sum of squares.

    References
    ----------
    P. B. Stark and R. L. Parker, Computational Statistics 10 (1995) 129: bounded-variable least squares.
    """
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    left, triangle = np.linalg.qr(columns / size)
    y = left.T @ target
    scaled = np.linalg.lstsq(triangle, y, rcond=1e-9)[0]
    if np.any(scaled < bounds[0] * size) or np.any(scaled > bounds[1] * size):
        low, high = bounds[0] * size, bounds[1] * size
        scaled = optimize.lsq_linear(triangle, y, bounds=(low, np.maximum(high, low + 1e-300)), method="bvls").x
    left_over = y - triangle @ scaled
    return scaled / size, float(y @ y - left_over @ left_over)
