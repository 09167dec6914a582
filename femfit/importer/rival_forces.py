"""Several force columns of one table: whether a smoother one contradicts the one that was taken."""

import numpy as np
import pandas as pd

from femfit.importer.check_noise import NoiseEstimate, estimate_noise
from femfit.importer.finding import Finding


def compare_forces(points: pd.DataFrame) -> list[Finding]:
    """Compare the force with the table's other force columns (``other:<header>``).

    By Newton's third law all of them are one force. Where a smoother column differs by more than its own noise, the
    difference is an error of the chosen one that may vary too slowly with distance to show as roughness.

    Parameters
    ----------
    points : DataFrame
        Tidy rows.

    Returns
    -------
    list of Finding
        ``rival-force``: a warning if a smoother column differs, nothing otherwise.
    """
    names = [str(name) for name in points if str(name).startswith("other:")]
    if not names:
        return []
    own = _size(estimate_noise(points))
    best: tuple[float, str, float] | None = None
    for name in names:
        other = points[name].to_numpy(dtype=float)
        if not np.isfinite(other).all() or not other.any():
            continue
        size = _size(estimate_noise(points, name))
        force = points["force"].to_numpy(dtype=float)
        smallest = (points["current"].abs() == points["current"].abs().min()).to_numpy()
        sign = np.sign(np.sum(other * force)) or 1.0  # a reaction points the other way
        scale = np.maximum(np.abs(other[smallest]), 1e-9 * np.abs(other).max())
        difference = float(np.median(np.abs(force[smallest] - sign * other[smallest]) / scale))
        if size < own / 2 and difference > 3 * size and (best is None or size < best[0]):
            best = (size, name.removeprefix("other:"), difference)
    if best is None:
        return []
    size, header, difference = best
    return [
        Finding(
            "rival-force",
            "warning",
            f"Column {header} is smoother (noise {100 * size:.2g} % of F against {100 * own:.2g} %) and differs by "
            f"{100 * difference:.2g} % (median at the smallest current): "
            "so much of the chosen force is probably error.",
            f"Take it with --force-column {header} if it is the same force.",
            difference,
        )
    ]


def _size(noise: NoiseEstimate) -> float:
    curves = [noise.passive] if noise.passive else list(noise.curves.values())
    return max((curve.relative for curve in curves), default=np.inf)
