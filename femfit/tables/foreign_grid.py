"""The points of an imported table: cells, units, the grid of currents and distances, and the sign of the force."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pandas as pd

from femfit.core.numerics import FloatArray
from femfit.core.results import Finding, listing
from femfit.core.text import counted
from femfit.tables.foreign_forms import QUANTITIES, REQUIRED
from femfit.tables.units import LEAST_TRAVEL_M, suspected_by_size, suspicion

_SAME_LEVEL = 1e-6  # of the axis' span: loops that add 0.1 ten times differ by 1e-16, units by rounding of 6 digits
_SAME_VALUE = 1e-9  # of the column's largest: a repeated row of the same solve, not of another mesh
_AGREEMENT = 0.95  # of the force change that must have one sign before it is called obvious
_SETTINGS = ("current_A", "distance_m")


def check_cells(points: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame, list[Finding]]:
    """Part the rows that have current, distance and force from the others, which come second."""
    finite = np.isfinite(points[list(REQUIRED)].to_numpy(dtype=float)).all(axis=1)
    bad = points[~finite].reset_index(drop=True)
    good = points[finite].reset_index(drop=True)
    findings = []
    if len(bad):
        text = (
            f"{len(bad)} of {counted(len(points), 'row')} {'has' if len(bad) == 1 else 'have'} no number "
            f"for current, distance or force: {rows_of(bad)}."
        )
        remedy = "Correct these rows, or give --accept cells to keep them as points without a result."
        findings.append(Finding("cells", "error", text, remedy, float(len(bad))))
    return good, bad, findings


def drop_incomplete(points: pd.DataFrame, quantities: list[str]) -> tuple[pd.DataFrame, list[Finding]]:
    """Leave out optional columns that have gaps: a fit that met them would have to invent numbers."""
    findings = []
    for quantity in [name for name in quantities if name in points]:
        gaps = points[~np.isfinite(points[quantity].to_numpy(dtype=float))]
        if len(gaps):
            points = points.drop(columns=quantity)
            text = f"The column of {quantity.replace('_', ' ')} has {counted(len(gaps), 'cell')} without a number "
            text += f"({rows_of(gaps)}) and is left out."
            remedy = "Complete it and import again if you need it."
            findings.append(Finding("gaps", "warning", text, remedy, float(len(gaps))))
    return points, findings


def rows_of(points: pd.DataFrame) -> str:
    """Where rows stand in their files."""
    parts = []
    for source, group in points.groupby("source", sort=False):
        parts.append(f"{source} line " + listing([str(line) for line in group["line"].unique()]))
    return "; ".join(parts[:4]) + ("; ..." if len(parts) > 4 else "")


def check_units(points: pd.DataFrame) -> list[Finding]:
    """Suspect units by sizes that no actuator has; current and distance, on which all else depends, are errors."""
    rows = pd.DataFrame({column: points[name] for name, column in QUANTITIES.items() if name in points})
    findings = [
        replace(finding, severity="error") if finding.column in _SETTINGS else finding
        for finding in suspected_by_size(rows, solved=True)
    ]
    distance = points["distance"].to_numpy(dtype=float)
    if 0 < float(np.max(distance)) < LEAST_TRAVEL_M:
        largest = suspicion("distance_m", "m", f"the largest is {np.max(distance) * 1e6:g} micrometres")
        findings.append(replace(largest, severity="error"))
    if (distance <= 0).any():
        where = points[distance <= 0]
        findings.append(
            Finding(
                "distance",
                "error",
                f"Distances must be > 0 (from the electromagnet's face); they go down to {np.min(distance):g} m: "
                f"{rows_of(where)}.",
                "If the positions count towards the electromagnet give --flip-distance; if they start elsewhere give "
                "--distance-start-mm (distance of position zero).",
                float(np.min(distance)),
            )
        )
    return findings


def snap_axis(values: FloatArray) -> FloatArray:
    """Replace each value by the first of its level, rounded to 12 digits: loops that add 0.1 ten times differ."""
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    tolerance = _SAME_LEVEL * (np.ptp(values) or abs(float(values[0])) or 1.0)
    starts = np.concatenate([[True], np.diff(ordered) > tolerance])
    levels = np.array([float(f"{value:.12g}") for value in ordered[starts]])
    snapped = np.empty_like(values)
    snapped[order] = levels[np.cumsum(starts) - 1]
    return snapped


def tidy_grid(points: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Snap, merge and sort the rows: by current, then distance, one row a point.

    Contradictory rows of one point stop the import; where that is accepted, their mean is taken.
    """
    points = points.assign(
        current=snap_axis(points["current"].to_numpy(dtype=float)),
        distance=snap_axis(points["distance"].to_numpy(dtype=float)),
    )
    points, findings = _merge_duplicates(points)
    ordered = points.sort_values(["current", "distance"], kind="stable")
    if not (_is_sorted(points, "current", "distance") or _is_sorted(points, "distance", "current")):
        findings.append(Finding("order", "info", "The rows were in no order; sorted by current, then distance."))
    points = ordered.reset_index(drop=True)
    currents, distances = np.unique(points["current"]), np.unique(points["distance"])
    for name, axis, unit in (("current", currents, "A"), ("distance", distances, "m")):
        if len(axis) == 1:
            findings.append(
                Finding(
                    f"one-{name}",
                    "error",
                    f"All rows have the same {name}, {axis[0]:g} {unit}.",
                    f"Import the files of all {name}s together, or give --accept one-{name}; a model cannot be fitted "
                    f"along the {name} then.",
                    1.0,
                )
            )
    return points, findings + _holes(points, currents, distances)


def _is_sorted(points: pd.DataFrame, outer: str, inner: str) -> bool:
    """Whether the rows run through the grid one line after the other, either way."""
    lines = (points[outer].diff().fillna(0) != 0).cumsum()
    steps = points.groupby(lines)[inner].diff().dropna()
    return bool(lines.nunique() == points[outer].nunique() and ((steps > 0).all() or (steps < 0).all()))


def _merge_duplicates(points: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    repeated = points.duplicated(["current", "distance"], keep=False)
    if not repeated.any():
        return points, []
    numeric = [str(name) for name in points if name not in {"source", "line", "current", "distance"}]
    groups = points.groupby(["current", "distance"], sort=False)[numeric]
    spread = groups.transform("max") - groups.transform("min")
    differs = (spread / points[numeric].abs().max().replace(0.0, 1.0)).max(axis=1)
    contradictory = points[differs > _SAME_VALUE]
    identical = int((points.duplicated(["current", "distance"]) & (differs <= _SAME_VALUE)).sum())
    findings = []
    if identical:
        text = f"{identical} repeated rows were dropped; they are identical."
        findings.append(Finding("duplicates", "info", text, size=float(identical)))
    if len(contradictory):
        count, worst = len(contradictory.drop_duplicates(["current", "distance"])), float(differs.max())
        findings.append(
            Finding(
                "contradictions",
                "error",
                f"{counted(count, 'point stands', 'points stand')} in the table more than once with "
                "different results (by up to "
                f"{100 * worst:.3g} % of the column's largest): {rows_of(contradictory)}.",
                "Keep one row of each, or give --accept contradictions to take their mean; a further axis of the sweep "
                "(temperature, mesh) must be imported one value at a time.",
                worst,
            )
        )
        means = groups.transform("mean")
        points = points.assign(**{name: means[name] for name in numeric})
    return points.drop_duplicates(["current", "distance"]).reset_index(drop=True), findings


def _holes(points: pd.DataFrame, currents: FloatArray, distances: FloatArray) -> list[Finding]:
    count = len(currents) * len(distances)
    missing = count - len(points)
    if not missing:
        return []
    if missing > count / 2:
        text = (
            f"The {len(points)} points are scattered: {counted(len(currents), 'current')} and "
            f"{counted(len(distances), 'distance')}."
        )
        remedy = "Checks that need a grid look at its complete part only."
        return [Finding("scattered", "warning", text, remedy, float(missing))]
    present = set(zip(points["current"], points["distance"], strict=True))
    holes = [f"({i:g} A, {d * 1e3:g} mm)" for i in currents for d in distances if (i, d) not in present]
    text = (
        f"{missing} of {counted(count, 'point')} of the grid {'is' if missing == 1 else 'are'} missing: "
        f"{listing(holes)}."
    )
    return [Finding("holes", "warning", text, "Solve them and import again; the fit does without them.", missing)]


def complete_grid(points: pd.DataFrame, quantities: list[str]) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
    """Find the largest complete part of the grid, leaving out the worst current or distance in turn.

    Its distances, its currents, and the values of each quantity, finite everywhere, of shape (n, m).
    """
    indexed = points.set_index(["distance", "current"])
    tables = [indexed[name].unstack() for name in quantities]  # noqa: PD010  # pivot_table would average
    absent = np.logical_or.reduce([~np.isfinite(table.to_numpy(dtype=float)) for table in tables])
    rows, columns = np.ones(absent.shape[0], bool), np.ones(absent.shape[1], bool)
    while (absent & rows[:, None] & columns).any():
        holes = absent & rows[:, None] & columns
        by_row, by_column = holes.sum(axis=1) / columns.sum(), holes.sum(axis=0) / rows.sum()
        if by_column.max() >= by_row.max():
            columns[by_column.argmax()] = False
        else:
            rows[by_row.argmax()] = False
    index, header = tables[0].index.to_numpy(dtype=float), tables[0].columns.to_numpy(dtype=float)
    return index[rows], header[columns], [table.to_numpy(dtype=float)[np.ix_(rows, columns)] for table in tables]


def settle_force_sign(
    points: pd.DataFrame, wish: Literal["auto", "keep", "flip"]
) -> tuple[pd.DataFrame, list[Finding]]:
    """Negate the force where it obviously counts away from the electromagnet, and say what was concluded.

    A current of growing magnitude attracts more. Where all forces are negative and grow in magnitude with the current,
    the sign is a matter of the axis and is flipped; where force and change have different signs, either the current's
    polarity or the force's axis may be reversed: that is said, not done.
    """
    findings: list[Finding] = []
    if wish == "flip":
        points = points.assign(force=-points["force"])
        findings.append(Finding("force-sign", "info", "The force was negated, as asked."))
    distances, currents, (force,) = complete_grid(points, ["force"])
    change, share = _growth(currents, force)
    negative = float(-np.minimum(force, 0).sum() / (np.abs(force).sum() or 1.0))
    if wish == "auto" and negative > _AGREEMENT and (change < 0 or share == 0) and len(distances):
        points, force, change = points.assign(force=-points["force"]), -force, -change
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


def _growth(currents: FloatArray, force: FloatArray) -> tuple[float, float]:
    """Sum over distances of the force gained with current, and how one-signed it is (0 unknown)."""
    candidates = currents >= 0 if (currents >= 0).sum() > 1 else np.ones(len(currents), bool)
    magnitudes = np.where(candidates, np.abs(currents), np.nan)
    if len(currents) < 2 or force.shape[0] == 0 or np.nanmax(magnitudes) == np.nanmin(magnitudes):
        return 0.0, 0.0
    gained = force[:, int(np.nanargmax(magnitudes))] - force[:, int(np.nanargmin(magnitudes))]
    total = float(np.abs(gained).sum())
    return float(gained.sum()), abs(float(gained.sum())) / total if total else 0.0


def _direction(force: FloatArray) -> list[Finding]:
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
