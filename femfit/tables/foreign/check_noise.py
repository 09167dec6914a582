"""Self-force noise of first-order field solvers: how large, and whether it is the same at every current."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.finding import Finding
from femfit.tables.foreign.check_grid import complete_grid
from femfit.tables.foreign.roughness import MIN_DISTANCES, Roughness, contrast_field, measure_roughness

NOISY = 0.005
"""Relative noise that is worth a warning: at the paper's rig 1 % of force moves a levitated magnet by 0.10 mm, so that
0.5 % is 0.05 mm, and second-order solutions stay below 0.4 % (tests/tables/test_importer_noise.py counts
false and missed alarms)."""

_COMMON, _GROWS = 0.8, 3.0
"""Share of the noise's variance in one pattern, and its growth over the currents, up to which it is a self-force."""

_ROUNDING = 1e-7
"""Of the largest force: tables are printed with six to ten digits, and no weight shall be infinite."""

_SUBSTANTIAL = 0.01
"""A current-free part below this share of the force at the largest current is no magnet's force."""


@dataclass(frozen=True)
class NoiseEstimate:
    """Noise of a force table: of each current's curve, and of the part at zero current, measured or extrapolated.

    Parameters
    ----------
    falls : float
        Share of the steps where the passive part (or the force at the smallest current) goes against its trend.
    common, growth : float
        Share of the noise's variance that is one pattern over the distances at every current, and the pattern's
        largest over smallest amplitude over the currents.
    """

    curves: dict[float, Roughness]
    passive: Roughness | None
    passive_measured: bool
    falls: float
    common: float
    growth: float


def estimate_noise(points: pd.DataFrame, quantity: str = "force") -> NoiseEstimate:
    """Measure the roughness of every force curve and of the current-free part; no curves below nine distances."""
    curves: dict[float, Roughness] = {}
    for current, group in points.groupby("current"):
        curve = measure_roughness(group["distance"].to_numpy(dtype=float), group[quantity].to_numpy(dtype=float))
        if curve is not None:
            curves[float(current)] = curve  # type: ignore[arg-type]  # pandas types group keys as scalars
    distances, currents, (force,) = complete_grid(points, [quantity])
    if len(distances) < MIN_DISTANCES or len(currents) == 0:
        return NoiseEstimate(curves, None, False, 0.0, 0.0, 1.0)
    measured = bool((currents == 0).any())
    passive_force = _at_zero_current(currents, force)
    substantial = np.median(np.abs(passive_force)) > _SUBSTANTIAL * np.median(np.abs(force), axis=0).max()
    passive = measure_roughness(distances, passive_force) if substantial else None
    trend_of = passive_force if substantial else force[:, int(np.argmax(np.abs(currents)))]
    common, growth = _common_pattern(distances, force)
    return NoiseEstimate(curves, passive, measured, _steps_against_trend(trend_of), common, growth)


def _at_zero_current(currents: FloatArray, force: FloatArray) -> FloatArray:
    """F(d, 0): the column, or the constant of a polynomial in the current of degree two at most, shape (n,)."""
    if (currents == 0).any():
        return np.array(force[:, int(np.flatnonzero(currents == 0)[0])])
    scale = float(np.abs(currents).max())
    powers = np.vander(currents / scale, min(3, len(currents)), increasing=True)
    solution, *_ = np.linalg.lstsq(powers, force.T, rcond=None)
    return np.array(solution[0])


def _steps_against_trend(force: FloatArray) -> float:
    steps = np.diff(force)
    return float(np.mean(steps * np.sign(force[-1] - force[0]) < 0))


def _common_pattern(distances: FloatArray, force: FloatArray) -> tuple[float, float]:
    """Share of the first singular pattern of the contrasts over distance and current, and its growth with current."""
    if not force.any():
        return 0.0, 1.0
    _, values, patterns = np.linalg.svd(contrast_field(distances, force, 2), full_matrices=False)
    amplitude = np.abs(patterns[0])
    share = float(values[0] ** 2 / np.sum(values**2)) if values.any() else 0.0
    return share, float(amplitude.max() / max(amplitude.min(), 1e-12))


def check_noise(points: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Warn of self-force noise with its size, and fill ``force_error`` with the estimated noise of each row.

    The estimate is a lower bound: an error that changes slowly with the distance leaves no roughness.

    Returns
    -------
    findings : list of Finding
        ``self-force`` (warning beyond 0.5 %) or ``noise`` (info).
    """
    noise = estimate_noise(points)
    if not noise.curves:
        text = f"The force's noise was not judged: that needs {MIN_DISTANCES} distances at one current."
        return points, [Finding("noise", "info", text)]
    judged = {current: curve for current, curve in noise.curves.items() if curve.resolved or curve.relative <= NOISY}
    if "force_error" not in points and judged:
        points = points.assign(force_error=_error_of_rows(points, judged))
    curves = [*noise.curves.values(), *([noise.passive] if noise.passive else [])]
    if max((curve.relative for curve in curves if curve.resolved), default=0.0) > NOISY:
        return points, [_warning(points, noise)]
    bound = max(curve.relative for curve in curves)
    if bound > NOISY:
        text = "The distances are too coarse to tell the force's noise from its curvature."
        return points, [Finding("noise", "info", text, "Add distances where the force changes fastest.")]
    text = f"The force is smooth: its noise is at most {100 * bound:.2g} % of F."
    return points, [Finding("noise", "info", text, size=bound)]


def _error_of_rows(points: pd.DataFrame, curves: dict[float, Roughness]) -> FloatArray:
    """Noise of each row; a current that could not be judged takes that of the nearest one, shape (n,)."""
    errors = np.empty(len(points))
    judged = np.array(list(curves))
    for current in points["current"].unique():
        rows = (points["current"] == current).to_numpy()
        nearest = judged[np.abs(judged - current).argmin()]
        known = points.loc[points["current"] == nearest, "distance"].to_numpy(dtype=float)
        distances = points.loc[rows, "distance"].to_numpy(dtype=float)
        errors[rows] = np.interp(distances, known, curves[float(nearest)].sigma_N)
    largest = float(points["force"].abs().max())
    return np.maximum(errors, _ROUNDING * largest)


def _warning(points: pd.DataFrame, noise: NoiseEstimate) -> Finding:
    currents = np.array(sorted(noise.curves))
    low, high = currents[np.abs(currents).argmin()], currents[np.abs(currents).argmax()]
    at_zero = noise.passive if noise.passive is not None else noise.curves[low]
    where = "at zero current" if noise.passive_measured else "of the part at zero current (extrapolated)"
    where = where if noise.passive is not None else f"at {low:g} A"
    sizes = f"{100 * at_zero.relative:.2g} % of F {where}"
    if high != low:
        sizes += f", {100 * noise.curves[high].relative:.2g} % at {high:g} A"
    error = float(points["force_error"].median())
    sentence = (
        f"The force is rough over the distance: {sizes} (standard deviation; median over the table {error:.2g} N)"
    )
    if noise.falls > 0.02:
        sentence += f", it goes against its own trend in {100 * noise.falls:.0f} % of the steps"
    if noise.common <= _COMMON:
        sentence += ", and differs from current to current: remeshing at each point or a loose solver tolerance."
    elif noise.growth < _GROWS:
        sentence += (
            ", the same at every current. That is how the self-force of a first-order mesh looks: the stress of a "
            "body's own field, which should integrate to zero, does not."
        )
    else:
        sentence += ", one pattern that grows with the current: the mesh's error in the field of the coil."
    return Finding(
        "self-force" if noise.common > _COMMON and noise.growth < _GROWS else "noise",
        "warning",
        sentence,
        "Such a table looks smooth enough to fit, and the error that varies slowly comes on top. Solve the moving part "
        "alone on the same mesh and subtract its force, or sweep with femfit.",
        at_zero.relative,
    )
