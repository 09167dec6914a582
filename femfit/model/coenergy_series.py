"""The co-energy of a base model as a Taylor series."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.taylor_series import TaylorSeries
from femfit.model.hall import HallField
from femfit.model.magnetics import Magnetics


@dataclass(frozen=True, eq=False)
class ModelCoenergy:
    """Co-energy and Hall field of a model, called as :data:`femfit.effects.taylor_series.CoenergySeries`."""

    magnetics: Magnetics
    hall: HallField | None  # B at the Hall element; zero where None

    def __call__(self, distance: FloatArray, current: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
        """Taylor coefficients at points (n,) in m and A."""
        orders = tuple((a, b) for a in range(in_distance + 1) for b in range(in_current + 1))
        factorials = np.cumprod(np.maximum(np.arange(max(in_distance, in_current) + 1.0), 1.0))
        result = np.zeros((2, in_distance + 1, in_current + 1, len(distance)))
        field = self.hall.partials(distance, current, orders) if self.hall else None
        for k, ((a, b), value) in enumerate(
            zip(orders, self.magnetics.coenergy_derivatives(distance, current, orders), strict=True)
        ):
            result[0, a, b] = value / (factorials[a] * factorials[b])
            if field is not None:
                result[1, a, b] = field[k] / (factorials[a] * factorials[b])
        return TaylorSeries(result)
