"""Whether a force table is smooth, and whether its force and flux linkage belong to one co-energy.

log|F| of a curve F(d) is contrasted over neighbours: for every q + 2 consecutive points the unit vector that
annihilates polynomials of degree q in log d. On white noise of relative size s each contrast has the variance s^2
whatever q; on a smooth curve the contrasts shrink with q. Where the robust spread of the last three orders agrees
within a factor of 1.8, their median is the noise; where it still falls, it is curvature.

The co-energy W'(d, i) is a state function: dW' = -F dd + lambda di. Around a rectangle d1..d2 x i1..i2 the circulation
vanishes, so that

    integral over d of F(d, i2) - F(d, i1)  =  integral over i of lambda(d1, i) - lambda(d2, i).

Integrals do not amplify noise as dF/di = -d(lambda)/dd would; an error of the force that is the same at every current
cancels, and so does a constant of the flux linkage.

References
----------
T. Gasser, L. Sroka, C. Jennen-Steinmetz, Residual variance and residual pattern in nonlinear regression, Biometrika 73
(1986) 625-633 (contrasts on uneven grids). H. H. Woodson, J. R. Melcher, Electromechanical Dynamics, Part I, Wiley
1968, section 3.1 (conservative fields).
"""

from itertools import product

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import CubicSpline
from scipy.stats import norm

from femfit.core.numerics import FloatArray, IntArray
from femfit.core.results import Finding
from femfit.tables.findings import finding
from femfit.tables.foreign_grid import complete_grid

NOISY = 0.005
"""Relative noise that is worth a warning: at a levitation rig 1 % of force moves the magnet by 0.10 mm, so that 0.5 %
is 0.05 mm, and second-order solutions stay below 0.4 %."""

MIN_DISTANCES = 9
"""Four orders of at least four contrasts: fewer points cannot tell noise from curvature."""

_ROUNDING = 1e-7
"""Of the largest force: tables are printed with six to ten digits, and no weight shall be infinite."""

_MAD_TO_SIGMA = 1 / norm.ppf(0.75)
_LARGEST_ORDER, _FEWEST_CONTRASTS = 5, 4
_FLAT = 1.8  # ratio of the last three spreads; most noisy curves of 9 points stay below, coarse smooth ones exceed

_AGREES = 0.02
"""First-order field solutions keep reciprocity within 1 %; coarse grids add as much by integration."""

_WRONG = 0.10
"""No mesh does this: units, turns or another quantity."""

_SAME_SHAPE = 0.10
"""Spread of the factor over the loops below which the two sides have one shape."""

_LARGE = 0.05  # rectangles whose work is below this share of the largest hold more noise than information


def check_noise(points: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Warn of noise with its size, and fill ``force_error_N`` with the estimated noise of each row.

    The estimate is a lower bound: an error that changes slowly with the distance leaves no roughness.
    """
    noise: dict[float, float] = {}
    coarse = False
    for current in np.unique(points["current_A"]).tolist():
        rows = points[points["current_A"] == current]
        roughness = measure_roughness(rows["distance_m"].to_numpy(dtype=float), rows["force_N"].to_numpy(dtype=float))
        if roughness is not None and (roughness[1] or roughness[0] <= NOISY):
            noise[current] = roughness[0]
        coarse |= roughness is not None and not roughness[1]
    if not noise:
        return points, [finding("noise coarse") if coarse else finding("noise few", fewest=MIN_DISTANCES)]
    if "force_error_N" not in points:
        relative = np.interp(points["current_A"], sorted(noise), [noise[current] for current in sorted(noise)])
        size = points["force_N"].abs()
        points = points.assign(force_error_N=np.maximum(relative * size, _ROUNDING * float(size.max())))
    worst = max(noise, key=lambda current: noise[current])
    percent = 100.0 * noise[worst]
    if noise[worst] <= NOISY:
        return points, [finding("noise smooth", size=noise[worst], percent=percent)]
    return points, [finding("noise", size=noise[worst], percent=percent, current=worst)]


def measure_roughness(distances: FloatArray, force: FloatArray) -> tuple[float, bool] | None:
    """Measure the noise of a force curve over ascending distances (m); None below nine of them or without force.

    Its robust standard deviation as a share of the force, and whether that is noise: where the spread still changes
    with the order it is the curvature of a coarse grid, and only an upper bound.
    """
    if len(distances) < MIN_DISTANCES or not np.any(force):
        return None
    x, y = np.log(distances), np.log(np.maximum(np.abs(force), 1e-6 * np.abs(force).max()))
    largest = min(_LARGEST_ORDER, len(distances) - _FEWEST_CONTRASTS - 1)
    spreads = [_spread(_contrasts(x, y, degree)) for degree in range(1, largest + 1)]
    resolved = max(spreads[-3:]) <= _FLAT * min(spreads[-3:])
    return (float(np.median(spreads[-3:])) if resolved else min(spreads)), resolved


def _contrasts(x: FloatArray, values: FloatArray, degree: int) -> FloatArray:
    """Divided differences of degree + 2 neighbours with weights of unit norm, shape (n - degree - 1,)."""
    windows = sliding_window_view(x, degree + 2)
    scaled = (windows - windows.mean(axis=1, keepdims=True)) / np.ptp(windows, axis=1)[:, None]
    differences = scaled[:, :, None] - scaled[:, None, :] + np.eye(degree + 2)
    weights = 1 / differences.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return np.asarray(np.sum(weights * sliding_window_view(values, degree + 2), axis=1))


def _spread(contrasts: FloatArray) -> float:
    """Standard deviation without outliers: root mean square of what lies within three robust deviations."""
    robust = float(np.median(np.abs(contrasts))) * _MAD_TO_SIGMA
    return float(np.sqrt(np.mean(contrasts[np.abs(contrasts) <= 3 * robust] ** 2)))


def check_reciprocity(points: pd.DataFrame) -> list[Finding]:
    """Compare the force's work with the flux linkage's.

    It is said where reciprocity holds or cannot be judged, a warning up to 10 %, an error beyond; without a column of
    flux linkages only that an inductance beside the force is not taken for one.
    """
    if "flux_linkage_Wb" not in points:
        return [finding("inductance")] if "inductance_H" in points else []
    distances, currents, (force, flux) = complete_grid(points, ["force_N", "flux_linkage_Wb"])
    if len(distances) < 3 or len(currents) < 2:
        return [finding("reciprocity unchecked")]
    factor, spread, loops = _compare_loops(distances, currents, force, flux)
    if loops == 0:
        return [finding("reciprocity still")]
    if spread >= _SAME_SHAPE:
        return [finding("reciprocity shape", size=spread, factor=factor, percent=100 * spread, loops=loops)]
    error = abs(factor - 1)
    if error >= _WRONG:
        return [finding("reciprocity factor", size=factor, percent=100 * spread, loops=loops)]
    key = "reciprocity holds" if error < max(_AGREES, spread) else "reciprocity rough"
    return [finding(key, size=error, percent=100 * error, loops=loops)]


def _compare_loops(
    distances: FloatArray, currents: FloatArray, force: FloatArray, flux_linkage: FloatArray
) -> tuple[float, float, int]:
    """Compare both sides over rectangles of a grid of n ascending distances (m) and m currents (A).

    Force (N) and flux linkage (Wb) have the shape (n, m). Median of flux side over force side, 1 for a table that is
    reciprocal; its robust relative spread, large if the two have different shapes; and the number of rectangles, 0
    where none holds any work.
    """
    # From the first level on; the work of any rectangle is a double difference of these
    force_side = CubicSpline(distances, force, axis=0).antiderivative()(distances)
    flux_side = -CubicSpline(currents, flux_linkage, axis=1).antiderivative()(currents)
    blocks = list(product(_blocks(len(distances)), _blocks(len(currents))))
    force_work, flux_work = (
        np.concatenate([np.diff(np.diff(side[np.ix_(*block)], axis=0), axis=1).ravel() for block in blocks])
        for side in (force_side, flux_side)
    )
    # The flux side decides which loops are large: a noisy force must not choose its own witnesses.
    keep = (np.abs(flux_work) >= _LARGE * np.abs(flux_work).max()) & (force_work != 0) & (flux_work != 0)
    if not keep.any():
        return np.nan, np.inf, 0
    ratios = flux_work[keep] / force_work[keep]
    factor = float(np.median(ratios))
    spread = float(np.median(np.abs(ratios - factor)) * _MAD_TO_SIGMA / abs(factor)) if factor else np.inf
    return factor, spread, int(keep.sum())


def _blocks(count: int) -> list[IntArray]:
    """Indices of an axis at its ends, and at the ends of its halves, quarters and eighths."""
    return [np.unique(np.linspace(0, count - 1, pieces + 1).round().astype(int)) for pieces in (1, 2, 4, 8)]
