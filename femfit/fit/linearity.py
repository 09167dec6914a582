"""Is the force linear in the current? The paper's Table 2, with its statistics right.

L_p = F(d, i_p) - F(d, i_p-1) should be the same for every pair of adjacent, equally spaced currents. Besides its
mean and standard deviation over the distances (a spread that the law itself causes, not an error), the part of the
force that is quadratic in the current is tested distance by distance: F = c_0 + c_1 i against c_0 + c_1 i + c_2 i^2.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eq. (4) and Table 2.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher

from femfit.core.arrays import FloatArray
from femfit.fit.rows import FitRows

# Relative residuals below this are rounding of stored numbers, not noise.
_ROUNDING = 1e-10


@dataclass(frozen=True, eq=False)
class LinearityTest:
    """The adjacent differences and the test of the quadratic part.

    Parameters
    ----------
    pairs_A : array, shape (p, 2)
        Adjacent currents.
    mean_N, sd_N : array, shape (p,)
        Mean and standard deviation over the distances of each difference.
    spread_between_pairs : float
        Largest difference of the means per ampere, over their mean: zero for a linear force.
    quadratic_share : float
        Rms of the i^2 part over the rms of the force's dependence on current.
    quadratic_of_force : float
        Largest i^2 part over the largest force.
    f_value, p_value : float or None
        F test of the quadratic part over all distances, its degrees of freedom below; None with fewer than four
        currents, and where a parabola leaves nothing but rounding (a superposed sweep): there is then no noise to test
        against. A small p proves a curvature; the two shares above say whether it matters.
    """

    pairs_A: FloatArray
    mean_N: FloatArray
    sd_N: FloatArray
    spread_between_pairs: float
    quadratic_share: float
    quadratic_of_force: float
    f_value: float | None
    p_value: float | None
    degrees_of_freedom: tuple[int, int]


def linearity_test(rows: FitRows) -> LinearityTest | None:
    """Test whether the force is linear in the current.

    Returns
    -------
    LinearityTest or None
        None with fewer than three currents, or where the rows are no full grid of distances and currents.
    """
    currents, distances = rows.currents, rows.distances
    if len(currents) < 3 or len(rows.force) != len(currents) * len(distances):
        return None
    order = np.lexsort((rows.distance, rows.current))
    force = rows.force[order].reshape(len(currents), len(distances))
    differences = np.diff(force, axis=0)
    per_ampere = differences.mean(axis=1) / np.diff(currents)
    quadratic, f_value, p_value, freedom = _quadratic_part(currents, force)
    change = force - force.mean(axis=0)
    return LinearityTest(
        pairs_A=np.stack([currents[:-1], currents[1:]], axis=1),
        mean_N=differences.mean(axis=1),
        sd_N=differences.std(axis=1, ddof=1),
        spread_between_pairs=float(np.ptp(per_ampere) / abs(per_ampere.mean())) if per_ampere.mean() else 0.0,
        quadratic_share=float(np.sqrt(np.mean(quadratic**2) / np.mean(change**2))) if np.any(change) else 0.0,
        quadratic_of_force=float(np.max(np.abs(quadratic)) / np.max(np.abs(force))),
        f_value=f_value,
        p_value=p_value,
        degrees_of_freedom=freedom,
    )


def quadratic_f_test(current: FloatArray, values: FloatArray, through_origin: bool = False) -> tuple[float, float]:
    """F test of an i^2 part beside a line.

    Parameters
    ----------
    current : array, shape (m,)
        A; m > 3.
    values : array, shape (m,)
        Any quantity, for example a coefficient of stage one.
    through_origin : bool
        Whether the line is c_1 i (the paper's f_b) rather than c_0 + c_1 i.

    Returns
    -------
    tuple of float
        F on (1, m - terms) degrees of freedom, and its p value.
    """
    powers = (1, 2) if through_origin else (0, 1, 2)
    matrix = current[:, None] ** np.array(powers, dtype=np.float64)
    q_factor = np.linalg.qr(matrix / np.linalg.norm(matrix, axis=0))[0]
    along = q_factor.T @ values
    freedom = len(values) - len(powers)
    f_value = float(along[-1] ** 2 / (np.sum((values - q_factor @ along) ** 2) / freedom))
    return f_value, float(fisher.sf(f_value, 1, freedom))


def _quadratic_part(
    currents: FloatArray, values: FloatArray
) -> tuple[FloatArray, float | None, float | None, tuple[int, int]]:
    """The i^2 part beside the best line, shape (m, n), and its F test pooled over the columns."""
    centred = (currents - currents.mean()) / (np.ptp(currents) or 1.0)
    q_factor = np.linalg.qr(np.stack([np.ones_like(centred), centred, centred**2], axis=1))[0]
    along = q_factor.T @ values
    part = np.outer(q_factor[:, 2], along[2])
    columns = values.shape[1]
    freedom = (columns, columns * (len(currents) - 3))
    if freedom[1] == 0:
        return part, None, None, freedom
    residual = float(np.sum((values - q_factor @ along) ** 2))
    if residual <= _ROUNDING**2 * float(np.sum(values**2)):
        return part, None, None, freedom
    f_value = float(np.sum(along[2] ** 2) / freedom[0] / residual * freedom[1])
    return part, f_value, float(fisher.sf(f_value, *freedom)), freedom
