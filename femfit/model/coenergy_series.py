"""The co-energy as a series, of a base model and as effects change it."""

from collections.abc import Iterable

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect, Coenergy, Parameters
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


def changed_coenergy(inner: CoenergySeries, effects: Iterable[AddedEffect], at: Conditions) -> CoenergySeries:
    """The co-energy as effects change it, the first named innermost; those with states last.

    A lag shifts the current that a core sees with all that the other effects say of it: inside of them, what they take
    for the magnet's own (W' without current) would hold a part of the lag.

    Parameters
    ----------
    effects : iterable of AddedEffect
        Those without a ``coenergy`` are passed over.
    """
    for added in sorted(effects, key=lambda added: added.effect.memory is not None):
        if added.effect.coenergy is not None:
            inner = _wrapped(inner, added.effect.coenergy, added.parameters, at)
    return inner


def _wrapped(inner: CoenergySeries, act: Coenergy, parameters: Parameters, at: Conditions) -> CoenergySeries:
    def evaluate(distance: FloatArray, current: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
        return act(inner, distance, current, in_distance, in_current, at, parameters)

    return evaluate
