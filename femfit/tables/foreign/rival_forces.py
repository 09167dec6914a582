"""Several force columns of one table: whether a smoother one contradicts the one that was taken."""

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.finding import Finding
from femfit.tables.foreign.check_noise import NoiseEstimate, estimate_noise


def compare_forces(points: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Compare the force with the table's other force columns (``other:<header>``).

    By Newton's third law all of them are one force. Where a smoother column differs by more than its own noise, the
    difference is an error of the chosen one that may vary too slowly with distance to show as roughness; it is added
    to ``force_error`` in squares. A column that differs by more than the force itself is another force.
    """
    names = [str(name) for name in points if str(name).startswith("other:")]
    if not names:
        return points, []
    force = points["force"].to_numpy(dtype=float)
    own = _size(estimate_noise(points))
    size, name, difference = min(
        ((_size(estimate_noise(points, name)), name, _difference(points, name)) for name in names),
        key=lambda rival: rival[0] if rival[2] < 1 else np.inf,
    )
    if not (size < own / 2 and 3 * size < difference < 1):
        return points, []
    if "force_error" in points:
        away = force - _oriented(points, name)
        points = points.assign(force_error=np.hypot(points["force_error"].to_numpy(dtype=float), away))
    header = name.removeprefix("other:")
    return points, [
        Finding(
            "rival-force",
            "warning",
            f"Column {header} is smoother (noise {100 * size:.2g} % of F against {100 * own:.2g} %) and differs by "
            f"{100 * difference:.2g} % (median at the smallest current): "
            "so much of the chosen force is probably error. The error of each row was raised by it.",
            f"Take it with --force-column {header} if it is the same force.",
            difference,
        )
    ]


def _oriented(points: pd.DataFrame, name: str) -> FloatArray:
    """Another force column with the sign of the chosen one: a reaction points the other way, shape (n,)."""
    other = points[name].to_numpy(dtype=float)
    sign = np.sign(np.sum(other * points["force"].to_numpy(dtype=float))) or 1.0
    return np.array(sign * other)


def _difference(points: pd.DataFrame, name: str) -> float:
    """Median relative difference at the smallest current; infinite for a column with gaps or without force."""
    other = _oriented(points, name)
    if not np.isfinite(other).all() or not other.any():
        return np.inf
    smallest = (points["current"].abs() == points["current"].abs().min()).to_numpy()
    scale = np.maximum(np.abs(other[smallest]), 1e-9 * np.abs(other).max())
    return float(np.median(np.abs(points["force"].to_numpy(dtype=float)[smallest] - other[smallest]) / scale))


def _size(noise: NoiseEstimate) -> float:
    curves = [noise.passive] if noise.passive else list(noise.curves.values())
    return max((curve.relative for curve in curves), default=np.inf)
