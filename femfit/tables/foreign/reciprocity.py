"""Reciprocity of force and flux linkage on a table, by closed loops in the (distance, current) plane.

The co-energy W'(d, i) is a state function: dW' = -F dd + lambda di. Around a rectangle d1..d2 x i1..i2 the circulation
vanishes, so that

    integral over d of F(d, i2) - F(d, i1)  =  integral over i of lambda(d1, i) - lambda(d2, i).

Integrals do not amplify noise as dF/di = -d(lambda)/dd would; an error of the force that is the same at every current
cancels, and so does a constant of the flux linkage.

References
----------
H. H. Woodson, J. R. Melcher, Electromechanical Dynamics, Part I, Wiley 1968, section 3.1 (conservative fields).
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from femfit.core.arrays import FloatArray

_LARGE = 0.05  # rectangles whose work is below this share of the largest hold more noise than information


@dataclass(frozen=True)
class LoopComparison:
    """Work of the force against that of the flux linkage over many rectangles.

    Parameters
    ----------
    factor : float
        Median of flux side / force side; 1 for a table that is reciprocal.
    spread : float
        Robust relative spread of that ratio over the rectangles; large if the two have different shapes.
    """

    factor: float
    spread: float
    loops: int


def compare_loops(
    distances: FloatArray, currents: FloatArray, force: FloatArray, flux_linkage: FloatArray
) -> LoopComparison:
    """Compare both sides over rectangles of a grid; the factor is NaN where no rectangle holds any work.

    Parameters
    ----------
    distances, currents : array, shape (n,) and (m,)
        m and A, ascending.
    force, flux_linkage : array, shape (n, m)
        N and Wb.
    """
    # From the first level on; the work of any rectangle is a double difference of these.
    force_side = CubicSpline(distances, force, axis=0).antiderivative()(distances)
    flux_side = -CubicSpline(currents, flux_linkage, axis=1).antiderivative()(currents)
    work, flux_work = [], []
    for a, b in _blocks(len(distances)):
        for j, k in _blocks(len(currents)):
            work.append((force_side[b, k] - force_side[a, k]) - (force_side[b, j] - force_side[a, j]))
            flux_work.append((flux_side[b, k] - flux_side[b, j]) - (flux_side[a, k] - flux_side[a, j]))
    left, right = np.array(work), np.array(flux_work)
    # The flux side decides which loops are large: a noisy force must not choose its own witnesses.
    keep = (np.abs(right) >= _LARGE * np.abs(right).max()) & (left != 0) & (right != 0)
    if not keep.any():
        return LoopComparison(np.nan, np.inf, 0)
    ratios = right[keep] / left[keep]
    factor = float(np.median(ratios))
    spread = float(np.median(np.abs(ratios - factor)) / 0.6745 / abs(factor)) if factor else np.inf
    return LoopComparison(factor, spread, int(keep.sum()))


def _blocks(count: int) -> list[tuple[int, int]]:
    """Index pairs of an axis: the whole, halves, quarters and eighths, without empty ones."""
    pairs: set[tuple[int, int]] = set()
    for parts in (1, 2, 4, 8):
        edges = np.unique(np.linspace(0, count - 1, parts + 1).round().astype(int))
        pairs.update(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    return sorted(pairs)
