"""The points of an imported table: cells, units, the grid of currents and distances, and the sign of the force."""

from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.core.numerics import FloatArray
from femfit.core.results import Finding, listing
from femfit.tables.findings import finding
from femfit.tables.foreign_forms import AXES, REQUIRED, SWEPT
from femfit.tables.units import column_unit, suspected_by_size

_SAME_LEVEL = 1e-6  # of the axis' span: loops that add 0.1 ten times differ by 1e-16, units by rounding of 6 digits
_SAME_VALUE = 1e-9  # of the column's largest: a repeated row of the same solve, not of another mesh
_AGREEMENT = 0.95  # of the force change that must have one sign before it is called obvious


def check_cells(points: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame, list[Finding]]:
    """Part the rows that have current, distance and force from the others, which come second."""
    finite = np.isfinite(points[list(REQUIRED)].to_numpy(dtype=float)).all(axis=1)
    bad = points[~finite].reset_index(drop=True)
    good = points[finite].reset_index(drop=True)
    findings = []
    if len(bad):
        facts = {"bad": len(bad), "rows": len(points), "places": rows_of(bad)}
        findings.append(finding("cells foreign", size=float(len(bad)), **facts))
    return good, bad, findings


def drop_incomplete(points: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Leave out optional columns that have gaps: a fit that met them would have to invent numbers."""
    findings = []
    for name in [name for name in SWEPT if name in points and name not in REQUIRED]:
        gaps = points[~np.isfinite(points[name].to_numpy(dtype=float))]
        if len(gaps):
            points = points.drop(columns=name)
            facts = {"quantity": column_unit(name)[0].replace("_", " "), "cells": len(gaps), "places": rows_of(gaps)}
            findings.append(finding("gaps", size=float(len(gaps)), **facts))
    return points, findings


def rows_of(points: pd.DataFrame) -> str:
    """Where rows stand in their files."""
    parts = []
    for source, group in points.groupby("source", sort=False):
        parts.append(f"{source} line " + listing([str(line) for line in group["line"].unique()]))
    return "; ".join(parts[:4]) + ("; ..." if len(parts) > 4 else "")


def check_units(points: pd.DataFrame) -> list[Finding]:
    """Suspect units by sizes that no actuator has; current and distance, on which all else depends, are errors."""
    rows = points[[name for name in SWEPT if name in points]]
    findings = [
        replace(remark, severity="error") if remark.column in AXES else remark
        for remark in suspected_by_size(rows, solved=True)
    ]
    distance = points["distance_m"].to_numpy(dtype=float)
    if (distance <= 0).any():
        findings.append(finding("distance", size=float(np.min(distance)), places=rows_of(points[distance <= 0])))
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
        current_A=snap_axis(points["current_A"].to_numpy(dtype=float)),
        distance_m=snap_axis(points["distance_m"].to_numpy(dtype=float)),
    )
    points, findings = _merge_duplicates(points)
    points = points.sort_values(["current_A", "distance_m"], kind="stable").reset_index(drop=True)
    currents, distances = np.unique(points["current_A"]), np.unique(points["distance_m"])
    for key, axis in (("one-current", currents), ("one-distance", distances)):
        if len(axis) == 1:
            findings.append(finding(key, size=1.0, level=axis[0]))
    return points, findings + _holes(points, currents, distances)


def _merge_duplicates(points: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    repeated = points.duplicated(["current_A", "distance_m"], keep=False)
    if not repeated.any():
        return points, []
    numeric = [str(name) for name in points if name not in {"source", "line", "current_A", "distance_m"}]
    groups = points.groupby(["current_A", "distance_m"], sort=False)[numeric]
    spread = groups.transform("max") - groups.transform("min")
    differs = (spread / points[numeric].abs().max().replace(0.0, 1.0)).max(axis=1)
    contradictory = points[differs > _SAME_VALUE]
    identical = int((points.duplicated(["current_A", "distance_m"]) & (differs <= _SAME_VALUE)).sum())
    findings = []
    if identical:
        findings.append(finding("duplicates", size=float(identical), rows=identical))
    if len(contradictory):
        count, worst = len(contradictory.drop_duplicates(["current_A", "distance_m"])), float(differs.max())
        places = rows_of(contradictory)
        findings.append(finding("contradictions", size=worst, points=count, percent=100 * worst, places=places))
        means = groups.transform("mean")
        points = points.assign(**{name: means[name] for name in numeric})
    return points.drop_duplicates(["current_A", "distance_m"]).reset_index(drop=True), findings


def _holes(points: pd.DataFrame, currents: FloatArray, distances: FloatArray) -> list[Finding]:
    count = len(currents) * len(distances)
    missing = count - len(points)
    if not missing:
        return []
    if missing > count / 2:
        counts = {"points": len(points), "currents": len(currents), "distances": len(distances)}
        return [finding("scattered", size=float(missing), **counts)]
    present = set(zip(points["current_A"], points["distance_m"], strict=True))
    holes = [f"({i:g} A, {d * 1e3:g} mm)" for i in currents for d in distances if (i, d) not in present]
    return [finding("holes", size=missing, holes=missing, points=count, places=listing(holes))]


def complete_grid(points: pd.DataFrame, quantities: list[str]) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
    """Find a complete part of the grid: without the distances that have holes, or without the currents.

    Its distances, its currents, and the values of each quantity, finite everywhere, of shape (n, m).
    """
    indexed = points.set_index(["distance_m", "current_A"])
    tables = [indexed[name].unstack() for name in quantities]  # noqa: PD010  # pivot_table would average
    holes = np.logical_or.reduce([~np.isfinite(table.to_numpy(dtype=float)) for table in tables])
    rows, columns = ~holes.any(axis=1), ~holes.any(axis=0)
    if rows.mean() >= columns.mean():
        columns[:] = True
    else:
        rows[:] = True
    index, header = tables[0].index.to_numpy(dtype=float), tables[0].columns.to_numpy(dtype=float)
    return index[rows], header[columns], [table.to_numpy(dtype=float)[np.ix_(rows, columns)] for table in tables]


def settle_force_sign(points: pd.DataFrame, *, keep: bool = False) -> tuple[pd.DataFrame, list[Finding]]:
    """Negate the force where it obviously counts away from the electromagnet, and say what was concluded.

    A current of growing magnitude attracts more. Where all forces are negative and grow in magnitude with the current,
    the sign is a matter of the axis and is flipped; where force and change have different signs, either the current's
    polarity or the force's axis may be reversed: that is said, not done.
    """
    findings: list[Finding] = []
    distances, currents, (force,) = complete_grid(points, ["force_N"])
    change, share = _growth(currents, force)
    negative = float(-np.minimum(force, 0).sum() / (np.abs(force).sum() or 1.0))
    if not keep and negative > _AGREEMENT and (change < 0 or share == 0) and len(distances):
        points, force, change = points.assign(force_N=-points["force_N"]), -force, -change
        reason = "its magnitude grows with the current" if share else "there is one current only"
        findings.append(finding("force-sign", why=reason))
    elif share > _AGREEMENT and change < 0:
        findings.append(finding("force-sign falling", size=share))
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
    return [finding("distance-direction", size=rising, times=size[-1] / (size[0] or np.inf))]
