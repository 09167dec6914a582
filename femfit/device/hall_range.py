"""Where the output of a Hall element leaves its range: there it says nothing of the distance."""

from typing import Any

import numpy as np

from femfit.core.amount import amount, amount_range
from femfit.core.arrays import FloatArray

REMEDY = "There it says nothing of the distance: take a wider range, or move the element."


def where_clipped(hall: Any, distance: FloatArray, current: FloatArray, field: FloatArray) -> str:
    """Where the output is clipped, as a clause such as ``clipped at 5 V from 1 to 6 mm at 0 A``; empty where nowhere.

    Each end of the range is said at the smallest current that reaches it, and at the current that does so farthest.

    Parameters
    ----------
    hall : HallElement or HallSensor
        Of a drawing or of a model.
    distance : array, shape (n,)
        In m.
    current : array, shape (n,), or (n, circuits)
        In A.
    field : array, shape (n,)
        In T; points without a field are passed over.
    """
    volts = hall.quiescent_V + hall.sensitivity_V_per_T * field
    ends = ((hall.output_max_V, volts >= hall.output_max_V), (hall.output_min_V, volts <= hall.output_min_V))
    clauses = []
    for end, clipped in ends:
        if not clipped.any():
            continue
        d, i = distance[clipped], current[clipped].reshape(np.count_nonzero(clipped), -1)
        size = np.linalg.norm(i, axis=1)
        chosen = dict.fromkeys(tuple(i[row].tolist()) for row in (np.argmin(size), np.lexsort((size, -d))[0]))
        places = []
        for each in chosen:
            at, amperes = d[np.all(i == each, axis=1)], " and ".join(amount(one, "A") for one in each)
            places.append(f"from {amount_range(at.min(), at.max(), 'm', 3)} at {amperes}")
        clauses.append(f"clipped at {end:g} V {', and '.join(places) if i.shape[1] > 1 else ' and '.join(places)}")
    return ", ".join(clauses)
