"""The paper's two figures of merit: global drift (17) and total uncertainty (18).

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, (17) and (18).
"""

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.errors import TableError

AVERAGE = 1.0
"""Seconds over which a field is averaged at each end of (17)."""


def global_drift(
    time: FloatArray, field: FloatArray, first: tuple[float, float], last: tuple[float, float], settling: float
) -> float:
    """delta_G = |B_F - B_B| / (T |B_B|), (17).

    B_B is taken ``settling`` after the first flat-top begins: the paper takes its beginning, where the eddy transient
    of 120 ppm alone makes 0.24 ppm/s over 500 s of a perfect sensor.

    Parameters
    ----------
    time, field : array, shape (n,)
        In s and T.
    first, last : (float, float)
        Begin and end of the first and the last flat-top, s.
    settling : float
        Seconds after the first flat-top's begin; 0 is the paper's definition.

    Returns
    -------
    float
        In 1/s; times 1e6 in ppm/s.

    Raises
    ------
    TableError
        If the record does not reach from one to the other.
    """
    start, end = first[0] + settling, last[1]
    if not (time[0] <= start and end <= time[-1] + AVERAGE and start + AVERAGE < end):
        raise TableError(
            f"The drift needs a record from {start:g} s to {end:g} s; instead received {time[0]:g} to {time[-1]:g} s."
        )
    begin = float(np.mean(field[(time >= start) & (time < start + AVERAGE)]))
    final = float(np.mean(field[(time >= end - AVERAGE) & (time < end)]))
    return abs(final - begin) / ((end - start - AVERAGE) * abs(begin))


def total_uncertainty(variance: float, field: float, reference_field: float, coverage: float = 2.0) -> float:
    """sigma_B of (18), expanded: k (sqrt(P) + |B - B_CS1|).

    The paper's sign of the difference is dropped: an uncertainty does not shrink with the side on which a field lies.

    Parameters
    ----------
    variance : float
        P: posterior for Kalman filters, accumulated for the others, T^2.
    field, reference_field : float
        B, and CS1's or the true field, T.
    coverage : float
        k; 1 is (18) as printed, 2 what Table 3 holds.
    """
    return float(coverage * (np.sqrt(variance) + abs(field - reference_field)))
