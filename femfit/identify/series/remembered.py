"""A co-energy that is evaluated once where it is asked for again and again."""

from femfit.core.arrays import FloatArray
from femfit.effects.jet import CoenergyJet, Jet

_ORDERS = (2, 3)
"""In distance and current, up to which effects ask for the base's series."""


def remembered(jet: CoenergyJet, distance: FloatArray, current: FloatArray) -> CoenergyJet:
    """A co-energy that is evaluated once at the points that most effects ask for.

    Parameters
    ----------
    jet : callable
        As from :func:`femfit.model.with_effects.base_jet`.
    distance, current : array, shape (n,)
        The points; recognised as these very arrays.
    """
    series = jet(distance, current, *_ORDERS)
    series.coefficients.flags.writeable = False

    def evaluate(d: FloatArray, i: FloatArray, in_distance: int, in_current: int) -> Jet:
        if d is distance and i is current and in_distance <= _ORDERS[0] and in_current <= _ORDERS[1]:
            return series.truncated(in_distance, in_current)
        return jet(d, i, in_distance, in_current)

    return evaluate
