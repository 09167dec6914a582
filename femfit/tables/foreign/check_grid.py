"""The grid of currents and distances: levels, duplicates, order, holes."""

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.finding import Finding, listing
from femfit.tables.foreign.check_cells import rows_of

_SAME_LEVEL = 1e-6  # of the axis' span: loops that add 0.1 ten times differ by 1e-16, units by rounding of 6 digits
_SAME_VALUE = 1e-9  # of the column's largest: a repeated row of the same solve, not of another mesh


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
    numeric = [name for name in points if name not in {"source", "line", "current", "distance"}]
    identical, contradictory, worst = 0, [], 0.0
    for _, group in points[repeated].groupby(["current", "distance"], sort=False):
        spread = np.array([np.ptp(group[name].to_numpy(dtype=float)) for name in numeric])
        scale = np.array([np.nanmax(np.abs(points[name].to_numpy(dtype=float)), initial=0.0) for name in numeric])
        relative = float(np.nanmax(spread / np.where(scale > 0, scale, 1.0), initial=0.0))
        if relative > _SAME_VALUE:
            contradictory.append(group)
            worst = max(worst, relative)
        else:
            identical += len(group) - 1
    findings = []
    if identical:
        findings.append(
            Finding(
                "duplicates",
                "info",
                f"{identical} repeated rows were dropped; they are identical.",
                size=float(identical),
            )
        )
    if contradictory:
        findings.append(
            Finding(
                "contradictions",
                "error",
                f"{len(contradictory)} points stand in the table more than once with different results (by up to "
                f"{100 * worst:.3g} % of the column's largest): {rows_of(pd.concat(contradictory))}.",
                "Keep one row of each, or give --accept contradictions to take their mean; a further axis of the sweep "
                "(temperature, mesh) must be imported one value at a time.",
                worst,
            )
        )
    means = points.groupby(["current", "distance"], sort=False)[numeric].transform("mean")
    merged = points.assign(**{str(name): means[name] for name in numeric}) if contradictory else points
    return merged.drop_duplicates(["current", "distance"]).reset_index(drop=True), findings


def _holes(points: pd.DataFrame, currents: FloatArray, distances: FloatArray) -> list[Finding]:
    count = len(currents) * len(distances)
    missing = count - len(points)
    if not missing:
        return []
    if missing > count / 2:
        sentence = f"The {len(points)} points are scattered: {len(currents)} currents and {len(distances)} distances."
        return [
            Finding(
                "scattered",
                "warning",
                sentence,
                "Checks that need a grid look at its complete part only.",
                float(missing),
            )
        ]
    present = set(zip(points["current"], points["distance"], strict=True))
    holes = [f"({i:g} A, {d * 1e3:g} mm)" for i in currents for d in distances if (i, d) not in present]
    return [
        Finding(
            "holes",
            "warning",
            f"{missing} of {count} points of the grid are missing: {listing(holes)}.",
            "Solve them and import again; the fit does without them.",
            float(missing),
        )
    ]


def complete_grid(points: pd.DataFrame, quantities: list[str]) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
    """Find the largest complete part of the grid, leaving out the worst current or distance in turn.

    Returns
    -------
    fields : list of array, shape (n, m)
        One a quantity, finite everywhere.
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
