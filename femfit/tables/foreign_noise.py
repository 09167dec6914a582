"""Noise of a force table, told from its curvature, and whether it is the same at every current: a self-force.

A curve F(d) is divided by a smooth positive envelope S(d) and contrasted over neighbours: for every q + 2 consecutive
points the unit vector that annihilates polynomials of degree q in log d. On white noise of relative size s each
contrast has variance s^2 whatever q; on a smooth curve the contrasts shrink with q. Where the robust spread of the
last three orders agrees within a factor of 1.8, their median is the noise; where it still falls, it is curvature.

References
----------
T. Gasser, L. Sroka, C. Jennen-Steinmetz, Residual variance and residual pattern in nonlinear regression, Biometrika 73
(1986) 625-633 (contrasts on uneven grids). P. Hall, J. W. Kay, D. M. Titterington, Asymptotically optimal
difference-based estimation of variance in nonparametric regression, Biometrika 77 (1990) 521-528 (higher orders).
"""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from scipy.stats import norm

from femfit.core.numerics import FloatArray
from femfit.core.results import Finding
from femfit.tables.columns import column_option
from femfit.tables.findings import finding
from femfit.tables.foreign_grid import complete_grid

NOISY = 0.005
"""Relative noise that is worth a warning: at a levitation rig 1 % of force moves the magnet by 0.10 mm, so that 0.5 %
is 0.05 mm, and second-order solutions stay below 0.4 % (the tests count false and missed alarms)."""

MIN_DISTANCES = 9
"""Four orders of at least four contrasts: fewer points cannot tell noise from curvature."""

_COMMON, _GROWS = 0.8, 3.0
"""Share of the noise's variance in one pattern, and its growth over the currents, up to which it is a self-force."""

_ROUNDING = 1e-7
"""Of the largest force: tables are printed with six to ten digits, and no weight shall be infinite."""

_MAD_TO_SIGMA = 1 / norm.ppf(0.75)
_VARIANCE_WITHIN_THREE = 0.9733  # of a standard normal cut at three
_MEAN_LOG_NORMAL = -(np.euler_gamma + math.log(2)) / 2  # mean of log|z|, z standard normal
_LARGEST_ORDER, _FEWEST_CONTRASTS = 5, 4
_FLAT = 1.8  # ratio of the last three spreads; most noisy curves of 9 points stay below, coarse smooth ones exceed


@dataclass(frozen=True, eq=False)
class Roughness:
    """Noise of one curve."""

    relative: float  # Robust standard deviation over the envelope of |F|; an upper bound where ``resolved`` is False
    resolved: bool  # False if the spread still changes with the order, so that it is curvature of a coarse grid
    sigma_N: FloatArray  # Estimated standard deviation of the force at each distance; shape (n,)


def check_noise(points: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Warn of noise with its size, and fill ``force_error_N`` with the estimated noise of each row.

    The estimate is a lower bound: an error that changes slowly with the distance leaves no roughness.
    """
    curves: dict[float, Roughness] = {}
    for current in np.unique(points["current_A"]):
        rows = points[points["current_A"] == current]
        curve = measure_roughness(rows["distance_m"].to_numpy(dtype=float), rows["force_N"].to_numpy(dtype=float))
        if curve is not None:
            curves[float(current)] = curve
    if not curves:
        return points, [finding("noise few", fewest=MIN_DISTANCES)]
    judged = {current: curve for current, curve in curves.items() if curve.resolved or curve.relative <= NOISY}
    if "force_error_N" not in points and judged:
        points = points.assign(force_error_N=_error_of_rows(points, judged))
    if max((curve.relative for curve in curves.values() if curve.resolved), default=0.0) > NOISY:
        return points, [_warning(points, curves)]
    bound = max(curve.relative for curve in curves.values())
    if bound > NOISY:
        return points, [finding("noise coarse")]
    return points, [finding("noise smooth", size=bound, percent=100 * bound)]


def compare_forces(points: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Compare the force with the table's other force columns (``other:<header>``).

    By Newton's third law all of them are one force. Where a smoother column differs by more than its own noise, the
    difference is an error of the chosen one that may vary too slowly with distance to show as roughness; it is added
    to ``force_error_N`` in squares. A column that differs by more than the force itself is another force.
    """
    smallest = points[points["current_A"].abs() == points["current_A"].abs().min()]
    force, distance = (smallest[name].to_numpy(dtype=float) for name in ("force_N", "distance_m"))
    roughness = measure_roughness(distance, force)
    best: tuple[float, str, float] | None = None
    for name in (str(name) for name in points if str(name).startswith("other:")):
        rival = _oriented(smallest, name)
        curve = measure_roughness(distance, rival) if np.isfinite(points[name].to_numpy(dtype=float)).all() else None
        if curve is None or roughness is None:
            continue
        scale = np.maximum(np.abs(rival), 1e-9 * float(points[name].abs().max()))
        difference = float(np.median(np.abs(force - rival) / scale))
        if difference < 1 and (best is None or curve.relative < best[0]):
            best = curve.relative, name, difference
    if best is None or roughness is None or not (best[0] < roughness.relative / 2 and 3 * best[0] < best[2]):
        return points, []
    size, name, difference = best
    if "force_error_N" in points:
        away = points["force_N"].to_numpy(dtype=float) - _oriented(points, name)
        points = points.assign(force_error_N=np.hypot(points["force_error_N"].to_numpy(dtype=float), away))
    header = name.removeprefix("other:")
    percent = {"rival": 100 * size, "noise": 100 * roughness.relative, "differs": 100 * difference}
    option = column_option(header, "force")
    return points, [finding("rival-force", size=difference, header=header, option=option, **percent)]


def _oriented(points: pd.DataFrame, name: str) -> FloatArray:
    """Another force column with the sign of the chosen one: a reaction points the other way, shape (n,)."""
    rival = points[name].to_numpy(dtype=float)
    return np.asarray((np.sign(np.sum(rival * points["force_N"].to_numpy(dtype=float))) or 1.0) * rival)


def _error_of_rows(points: pd.DataFrame, curves: dict[float, Roughness]) -> FloatArray:
    """Noise of each row; a current that could not be judged takes that of the nearest one, shape (n,)."""
    errors, judged = np.empty(len(points)), np.array(list(curves))
    for current in points["current_A"].unique():
        rows = (points["current_A"] == current).to_numpy()
        nearest = judged[np.abs(judged - current).argmin()]
        places = points.loc[points["current_A"] == nearest, "distance_m"].to_numpy(dtype=float)
        distances = points.loc[rows, "distance_m"].to_numpy(dtype=float)
        errors[rows] = np.interp(distances, places, curves[float(nearest)].sigma_N)
    return np.maximum(errors, _ROUNDING * float(points["force_N"].abs().max()))


def _warning(points: pd.DataFrame, curves: dict[float, Roughness]) -> Finding:
    currents = np.array(sorted(curves))
    low, high = (float(currents[pick(np.abs(currents))]) for pick in (np.argmin, np.argmax))
    sizes = f"{100 * curves[low].relative:.2g} % of F at {low:g} A"
    if high != low:
        sizes += f", {100 * curves[high].relative:.2g} % at {high:g} A"
    sizes += f" (standard deviation; median over the table {float(points['force_error_N'].median()):.2g} N)"
    common, growth = _common_pattern(points)
    key = "noise" if common <= _COMMON else "self-force" if growth < _GROWS else "noise grows"
    return finding(key, size=curves[low].relative, sizes=sizes)


def _common_pattern(points: pd.DataFrame) -> tuple[float, float]:
    """Share of the noise's variance in one pattern over the distances, and its growth over the currents.

    All currents' curves are divided by one envelope, so that equal errors in newtons stay equal.
    """
    distances, _, (force,) = complete_grid(points, ["force_N"])
    if len(distances) < MIN_DISTANCES or not force.any():
        return 0.0, 1.0
    x = np.log(distances)
    envelope = _envelope(x, np.median(np.abs(force), axis=1) + 1e-9 * np.abs(force).max())
    contrasts = np.stack([_contrasts(x, column / envelope, 2) for column in force.T], axis=1)
    _, values, patterns = np.linalg.svd(contrasts, full_matrices=False)
    amplitude = np.abs(patterns[0])
    share = float(values[0] ** 2 / np.sum(values**2)) if values.any() else 0.0
    return share, float(amplitude.max() / max(amplitude.min(), 1e-12))


def measure_roughness(distances: FloatArray, force: FloatArray) -> Roughness | None:
    """Measure the noise of a force curve over ascending distances (m); None below nine of them or without force."""
    if len(distances) < MIN_DISTANCES or not np.any(force):
        return None
    x = np.log(distances)
    envelope = _envelope(x, force)
    largest = min(_LARGEST_ORDER, len(distances) - _FEWEST_CONTRASTS - 1)
    families = [_contrasts(x, force / envelope, degree) for degree in range(1, largest + 1)]
    spreads = [_spread(family) for family in families]
    resolved = max(spreads[-3:]) <= _FLAT * min(spreads[-3:])
    taken = largest - 3 + int(np.argsort(spreads[-3:])[1]) if resolved else int(np.argmin(spreads))
    sigma = _local_sigma(x, families[taken], taken + 1, spreads[taken]) * envelope
    return Roughness(spreads[taken], resolved, sigma)


def _contrasts(x: FloatArray, values: FloatArray, degree: int) -> FloatArray:
    """Divided differences of degree + 2 neighbours with weights of unit norm, shape (n - degree - 1,)."""
    windows = sliding_window_view(x, degree + 2)
    scaled = (windows - windows.mean(axis=1, keepdims=True)) / np.ptp(windows, axis=1)[:, None]
    differences = scaled[:, :, None] - scaled[:, None, :] + np.eye(degree + 2)
    weights = 1 / differences.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    contrasts: FloatArray = np.sum(weights * sliding_window_view(values, degree + 2), axis=1)
    return contrasts


def _spread(contrasts: FloatArray) -> float:
    """Standard deviation without outliers: root mean square of what lies within three robust deviations."""
    robust = float(np.median(np.abs(contrasts))) * _MAD_TO_SIGMA
    inside = contrasts[np.abs(contrasts) <= 3 * robust]
    return float(np.sqrt(np.mean(inside**2) / _VARIANCE_WITHIN_THREE))


def _envelope(x: FloatArray, force: FloatArray) -> FloatArray:
    """Smooth positive size of a curve: a robust polynomial of log|F| over log d, shape (n,)."""
    size = np.abs(force)
    target = np.log(np.maximum(size, 1e-6 * size.max()))
    basis = np.vander(2 * (x - x.mean()) / np.ptp(x), 4 if len(x) > 9 else 3)
    weights = np.ones(len(x))
    fitted = target
    for _ in range(10):
        solution, *_ = np.linalg.lstsq(basis * weights[:, None], target * weights, rcond=None)
        fitted = basis @ solution
        residual = target - fitted
        scale = np.median(np.abs(residual)) * _MAD_TO_SIGMA + 1e-9
        weights = 1 / np.sqrt(1 + (residual / (2 * scale)) ** 2)  # Cauchy weights: a sign change is no size
    envelope: FloatArray = np.exp(fitted)
    return envelope


def _local_sigma(x: FloatArray, contrasts: FloatArray, order: int, overall: float) -> FloatArray:
    """Relative noise as a power of d: a magnet's self-force error falls more slowly than its force, shape (n,)."""
    if len(contrasts) < 12 or overall == 0:
        return np.full(len(x), overall)
    centres = np.array([x[start : start + order + 2].mean() for start in range(len(contrasts))])
    size = np.log(np.maximum(np.abs(contrasts), 0.02 * overall)) - _MEAN_LOG_NORMAL
    slope, level = np.polyfit(centres - x.mean(), size, 1)
    sigma: FloatArray = np.clip(np.exp(level + slope * (x - x.mean())), overall / 10, 10 * overall)
    return sigma
