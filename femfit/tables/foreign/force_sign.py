"""The sign of the force: positive towards the electromagnet, growing with the current."""

from typing import Literal

import numpy as np
import pandas as pd

from femfit.core.finding import Finding
from femfit.tables.foreign.check_grid import complete_grid

_AGREEMENT = 0.95  # of the force change that must have one sign before it is called obvious


def settle_force_sign(
    points: pd.DataFrame, wish: Literal["auto", "keep", "flip"]
) -> tuple[pd.DataFrame, list[Finding]]:
    """Negate the force where it obviously counts away from the electromagnet, and say what was concluded.

    A current of growing magnitude attracts more: sum over d of F(d, i_large) - F(d, i_small) is positive. Where all
    forces are negative and grow in magnitude with the current, the sign is a matter of the axis and is flipped. Where
    force and change have different signs, either the current's polarity or the force's axis may be reversed: that is
    said, not done.

    Returns
    -------
    findings : list of Finding
        ``force-sign`` and, where the force grows with distance, ``distance-direction``.
    """
    findings: list[Finding] = []
    if wish == "flip":
        points = _flipped(points)
        findings.append(Finding("force-sign", "info", "The force was negated, as asked."))
    distances, currents, (force,) = complete_grid(points, ["force"])
    change, share = _growth(currents, force)
    negative = float(-np.minimum(force, 0).sum() / (np.abs(force).sum() or 1.0))
    if wish == "auto" and negative > _AGREEMENT and (change < 0 or share == 0) and len(distances):
        points, force, change = _flipped(points), -force, -change
        reason = "its magnitude grows with the current" if share else "there is one current only"
        findings.append(
            Finding(
                "force-sign",
                "info",
                f"All forces are negative and {reason}: taken as counted away from the electromagnet and negated.",
                "Give --keep-force if the force really repels.",
            )
        )
    elif share > _AGREEMENT and change < 0:
        findings.append(
            Finding(
                "force-sign",
                "warning",
                "The attraction falls with growing current; femfit counts the current so that it attracts.",
                "Give --flip-current if the coil was wound or fed the other way, --flip-force if the force counts away "
                "from the electromagnet, or both.",
                share,
            )
        )
    return points, findings + _direction(force)


def _flipped(points: pd.DataFrame) -> pd.DataFrame:
    names = ["force", *(name for name in points if str(name).startswith("other:"))]
    return points.assign(**{str(name): -points[name] for name in names})


def _growth(currents: np.ndarray, force: np.ndarray) -> tuple[float, float]:
    """Sum over distances of the force gained with current, and how one-signed it is (0 unknown)."""
    candidates = currents >= 0 if (currents >= 0).sum() > 1 else np.ones(len(currents), bool)
    magnitudes = np.where(candidates, np.abs(currents), np.nan)
    if len(currents) < 2 or force.shape[0] == 0 or np.nanmax(magnitudes) == np.nanmin(magnitudes):
        return 0.0, 0.0
    gained = force[:, int(np.nanargmax(magnitudes))] - force[:, int(np.nanargmin(magnitudes))]
    total = float(np.abs(gained).sum())
    return float(gained.sum()), abs(float(gained.sum())) / total if total else 0.0


def _direction(force: np.ndarray) -> list[Finding]:
    if force.shape[0] < 4:
        return []
    size = np.median(np.abs(force), axis=1)
    rising = float(np.mean(np.diff(size) > 0))
    if rising < _AGREEMENT or size[-1] < 2 * size[0]:
        return []
    return [
        Finding(
            "distance-direction",
            "warning",
            f"The force grows with the distance, {size[-1] / (size[0] or np.inf):.3g} times over the table.",
            "If the column is a position that counts towards the electromagnet, give --flip-distance with "
            "--distance-start-mm.",
            rising,
        )
    ]
