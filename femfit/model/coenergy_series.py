"""The co-energy of a base model as a Taylor series."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries
from femfit.model.hall import HallField
from femfit.model.magnetics import Magnetics

KEPT = 64
"""Numerical: series that are kept; effects ask for one or two points a reading each."""


@dataclass(frozen=True, eq=False)
class RepeatedCoenergy:
    """A co-energy that gives again what it gave before: a fit changes one size of one effect at a time."""

    coenergy: CoenergySeries
    _known: dict[tuple[bytes, bytes, int, int], TaylorSeries] = field(default_factory=dict, init=False, repr=False)

    def __call__(self, distance: FloatArray, current: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
        """Taylor coefficients at points (n,) in m and A, not to be written to."""
        key = (distance.tobytes(), current.tobytes(), in_distance, in_current)
        series = self._known.pop(key, None)
        if series is None:
            series = self.coenergy(distance, current, in_distance, in_current)
            series.coefficients.flags.writeable = False
            while len(self._known) >= KEPT:
                self._known.pop(next(iter(self._known)))
        self._known[key] = series  # the newest last
        return series


@dataclass(frozen=True, eq=False)
class ModelCoenergy:
    """Co-energy and Hall field of a model, called as :data:`femfit.effects.taylor_series.CoenergySeries`."""

    magnetics: Magnetics
    hall: HallField | None  # B at the Hall element; zero where None

    def __call__(self, distance: FloatArray, current: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
        """Taylor coefficients at points (n,) in m and A."""
        orders = tuple((a, b) for a in range(in_distance + 1) for b in range(in_current + 1))
        field = None if self.hall is None else self.hall.partials(distance, current, orders)
        result = np.zeros((2, in_distance + 1, in_current + 1, len(distance)))
        result[0] = taylor(self.magnetics.coenergy_derivatives(distance, current, orders), in_distance, in_current)
        if field is not None:
            result[1] = taylor(field, in_distance, in_current)
        return TaylorSeries(result)


def taylor(derivatives: Sequence[FloatArray], in_distance: int, in_current: int) -> FloatArray:
    """Taylor coefficients, shape (A + 1, B + 1, n), from derivatives of orders (0, 0), (0, 1), .. (A, B)."""
    factorials = np.cumprod(np.maximum(np.arange(max(in_distance, in_current) + 1.0), 1.0))
    both = factorials[: in_distance + 1, None] * factorials[: in_current + 1]
    return np.asarray(np.reshape(derivatives, (*both.shape, -1)) / both[..., None])
