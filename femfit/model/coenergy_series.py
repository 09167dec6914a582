"""The co-energy of a base model as a Taylor series."""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries
from femfit.model.hall import HallField
from femfit.model.magnetics import Magnetics


def coenergy_series(magnetics: Magnetics, hall: HallField | None) -> CoenergySeries:
    """Co-energy and Hall field as a series.

    Parameters
    ----------
    hall : HallField or None
        B at the Hall element; zero where None.

    Returns
    -------
    callable
        (distances, currents, A, B) -> :class:`femfit.effects.taylor_series.TaylorSeries`.
    """

    def evaluate(distance: FloatArray, current: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
        orders = tuple((a, b) for a in range(in_distance + 1) for b in range(in_current + 1))
        factorials = np.cumprod(np.maximum(np.arange(max(in_distance, in_current) + 1.0), 1.0))
        result = np.zeros((2, in_distance + 1, in_current + 1, len(distance)))
        field = hall.partials(distance, current, orders) if hall else None
        for k, ((a, b), value) in enumerate(
            zip(orders, magnetics.coenergy_derivatives(distance, current, orders), strict=True)
        ):
            result[0, a, b] = value / (factorials[a] * factorials[b])
            if field is not None:
                result[1, a, b] = field[k] / (factorials[a] * factorials[b])
        return TaylorSeries(result)

    return evaluate
