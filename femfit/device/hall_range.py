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
    distance, current, field : array, shape (n,)
        In m, A and T; points without a field are passed over.
    """
    volts = hall.quiescent_V + hall.sensitivity_V_per_T * field
    ends = ((hall.output_max_V, volts >= hall.output_max_V), (hall.output_min_V, volts <= hall.output_min_V))
    clauses = []
    for end, clipped in ends:
        if not clipped.any():
            continue
        d, i = distance[clipped], current[clipped]
        chosen = dict.fromkeys((float(i[np.argmin(np.abs(i))]), float(i[np.lexsort((np.abs(i), -d))[0]])))
        places = [
            f"from {amount_range(d[i == at].min(), d[i == at].max(), 'm', 3)} at {amount(at, 'A')}" for at in chosen
        ]
        clauses.append(f"clipped at {end:g} V {' and '.join(places)}")
    return ", ".join(clauses)
