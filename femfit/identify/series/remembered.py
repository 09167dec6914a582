"""A co-energy that is evaluated once where it is asked for again and again."""

from femfit.core.arrays import FloatArray
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries

_ORDERS = (2, 3)
"""In distance and current, up to which effects ask for the base's series."""


def remembered(coenergy: CoenergySeries, distance: FloatArray, current: FloatArray) -> CoenergySeries:
    """A co-energy that is evaluated once at the points that most effects ask for.

    Parameters
    ----------
    distance, current : array, shape (n,)
        The points; recognised as these very arrays.
    """
    series = coenergy(distance, current, *_ORDERS)
    series.coefficients.flags.writeable = False

    def evaluate(d: FloatArray, i: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
        if d is distance and i is current and in_distance <= _ORDERS[0] and in_current <= _ORDERS[1]:
            return series.truncated(in_distance, in_current)
        return coenergy(d, i, in_distance, in_current)

    return evaluate
