"""The points of an imported table: cells, units, the grid of currents and distances, and the sign of the force.

Whether a force table is smooth, and whether its force and flux linkage belong to one co-energy.

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

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import CubicSpline

from femfit.core.numerics import FloatArray, IntArray, even_scale, robust_deviation
from femfit.core.results import Finding, listing
from femfit.tables.checks import Check, Expected, changing, suspected_units
from femfit.tables.findings import finding
from femfit.tables.foreign_forms import AXES, REQUIRED, SWEPT
from femfit.tables.units import column_unit

_SAME_VALUE = 1e-9  # of the column's largest: a repeated row of the same solve, not of another mesh
_AGREEMENT = 0.95  # of the force change that must have one sign before it is called obvious

NOISY = 0.005
"""Relative noise that is worth a warning: at a levitation rig 1 % of force moves the magnet by 0.10 mm, so that 0.5 %
is 0.05 mm, and second-order solutions stay below 0.4 %."""

MIN_DISTANCES = 9
"""Four orders of at least four contrasts: fewer points cannot tell noise from curvature."""

_ROUNDING = 1e-7
"""Of the largest force: tables are printed with six to ten digits, and no weight shall be infinite."""

_LARGEST_ORDER, _FEWEST_CONTRASTS = 5, 4
_FLAT = 1.8  # ratio of the last three spreads; most noisy curves of 9 points stay below, coarse smooth ones exceed

_AGREES = 0.02
"""First-order field solutions keep reciprocity within 1 %; coarse grids add as much by integration."""

_WRONG = 0.10
"""No mesh does this: units, turns or another quantity."""

_SAME_SHAPE = 0.10
"""Spread of the factor over the loops below which the two sides have one shape."""

_LARGE = 0.05  # rectangles whose work is below this share of the largest hold more noise than information


def incomplete_rows(points: pd.DataFrame, _model: Expected | None) -> list[Finding]:
    """Rows without a current, a distance or a force, which are left out."""
    complete = np.isfinite(points[list(REQUIRED)].to_numpy(dtype=float)).all(axis=1)
    bad = points[~complete]
    if bad.empty:
        return []
    facts = {"bad": len(bad), "rows": len(points), "places": rows_of(bad)}
    remark = finding("cells foreign", size=float(len(bad)), **facts)
    return [changing(remark, lambda frame: frame[complete].reset_index(drop=True))]


def gaps(points: pd.DataFrame, _model: Expected | None) -> list[Finding]:
    """Optional columns with gaps, which are left out: a fit that met them would have to invent numbers."""
    findings: list[Finding] = []
    for name in (name for name in SWEPT[len(REQUIRED) :] if name in points):
        lacking = points[~np.isfinite(points[name].to_numpy(dtype=float))]
        if len(lacking):
            facts = {"quantity": column_unit(name)[0].replace("_", " "), "places": rows_of(lacking)}
            remark = finding("gaps", size=float(len(lacking)), cells=len(lacking), **facts)
            findings.append(changing(remark, partial(pd.DataFrame.drop, columns=name)))
    return findings


def rows_of(points: pd.DataFrame) -> str:
    """Where rows stand in their files."""
    files = points.groupby("source", sort=False)["line"].unique()
    parts = [f"{source} line {listing(lines)}" for source, lines in files.items()]
    return "; ".join([*parts[:4], *(["..."] if len(parts) > 4 else [])])


def solved_sizes(points: pd.DataFrame, _model: Expected | None) -> list[Finding]:
    """Sizes that no actuator has, and distances that do not count from its face; of what all depends on, errors."""
    remarks = suspected_units(points[[name for name in SWEPT if name in points]], None, solved=True)
    findings = [replace(remark, severity="error") if remark.column in AXES else remark for remark in remarks]
    behind = points[points["distance_m"] <= 0]
    if len(behind):
        findings.append(finding("distance", size=float(behind["distance_m"].min()), places=rows_of(behind)))
    return findings


def repeated_points(points: pd.DataFrame, _model: Expected | None) -> list[Finding]:
    """Points that stand in a table more than once; of contradictory rows the mean is taken where they are accepted."""
    repeated = points.duplicated(list(AXES))
    if not repeated.any():
        return []
    numeric = [str(name) for name in points if name not in {"source", "line", *AXES}]
    groups = points.groupby(list(AXES), sort=False)[numeric]
    spread = groups.transform("max") - groups.transform("min")
    differs = (spread / points[numeric].abs().max().replace(0.0, 1.0)).max(axis=1)
    contradictory, identical = points[differs > _SAME_VALUE], int((repeated & (differs <= _SAME_VALUE)).sum())
    findings: list[Finding] = []
    if identical:
        findings.append(finding("duplicates", size=float(identical), rows=identical))
    means = groups.transform("mean") if len(contradictory) else points[numeric]
    if len(contradictory):
        count, worst = len(contradictory.drop_duplicates(list(AXES))), float(differs.max())
        facts = {"points": count, "percent": 100 * worst, "places": rows_of(contradictory)}
        findings.append(finding("contradictions", size=worst, **facts))
    findings[-1] = changing(findings[-1], lambda frame: frame.assign(**means)[~repeated].reset_index(drop=True))
    return findings


def holes_of_grid(points: pd.DataFrame, _model: Expected | None) -> list[Finding]:
    """Points that a grid of all currents and distances lacks, and axes of one level."""
    currents, distances = np.unique(points["current_A"]), np.unique(points["distance_m"])
    axes = (("one-current", currents), ("one-distance", distances))
    findings = [finding(key, size=1.0, level=axis[0]) for key, axis in axes if len(axis) == 1]
    count = len(currents) * len(distances)
    missing = count - len(points)
    if missing > count / 2:
        counts = {"points": len(points), "currents": len(currents), "distances": len(distances)}
        findings.append(finding("scattered", size=float(missing), **counts))
    elif missing:
        present = set(zip(points["current_A"], points["distance_m"], strict=True))
        grid = product(currents, distances)
        places = listing(f"({i:g} A, {d * 1e3:g} mm)" for i, d in grid if (i, d) not in present)
        findings.append(finding("holes", size=missing, holes=missing, points=count, places=places))
    return findings


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


def force_sign(points: pd.DataFrame, _model: Expected | None, *, keep: bool = False) -> list[Finding]:
    """Whether the force counts away from the electromagnet, which turns it, or other axes count the other way.

    A current of growing magnitude attracts more. Where all forces are negative and grow in magnitude with the current,
    the sign is a matter of the axis and is flipped; where force and change have different signs, either the current's
    polarity or the force's axis may be reversed: that is said, not done.
    """
    findings: list[Finding] = []
    distances, currents, (force,) = complete_grid(points, ["force_N"])
    # Summed over distances, the force that is gained with current, and how one-signed it is
    strength = np.where((currents >= 0) | ((currents >= 0).sum() < 2), np.abs(currents), np.nan)
    gained = np.zeros(1)
    if len(currents) > 1 and len(distances):
        gained = force[:, int(np.nanargmax(strength))] - force[:, int(np.nanargmin(strength))]
    change, share = float(gained.sum()), float(abs(gained.sum()) / (np.abs(gained).sum() or 1.0))
    negative = float(-np.minimum(force, 0).sum() / (np.abs(force).sum() or 1.0))
    if not keep and negative > _AGREEMENT and (change < 0 or share == 0) and len(distances):
        reason = "its magnitude grows with the current" if share else "there is one current only"
        turned = finding("force-sign", why=reason)
        findings.append(changing(turned, lambda frame: frame.assign(force_N=-frame["force_N"])))
    elif share > _AGREEMENT and change < 0:
        findings.append(finding("force-sign falling", size=share))
    size = np.median(np.abs(force), axis=1)
    rising = float(np.mean(np.diff(size) > 0)) if len(size) >= 4 else 0.0
    if rising >= _AGREEMENT and size[-1] >= 2 * size[0]:
        findings.append(finding("distance-direction", size=rising, times=size[-1] / (size[0] or np.inf)))
    return findings


def force_noise(points: pd.DataFrame, _model: Expected | None) -> list[Finding]:
    """The noise of the force with its size, which becomes the ``force_error_N`` of each row where there is none.

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
        return [finding("noise coarse") if coarse else finding("noise few", fewest=MIN_DISTANCES)]
    worst = max(noise, key=lambda current: noise[current])
    code = "noise smooth" if noise[worst] <= NOISY else "noise"
    remark = finding(code, size=noise[worst], percent=100.0 * noise[worst], current=worst)
    if "force_error_N" in points:
        return [remark]
    relative, size = np.interp(points["current_A"], [*noise], [*noise.values()]), points["force_N"].abs()
    error = np.maximum(relative * size, _ROUNDING * float(size.max()))
    return [changing(remark, partial(pd.DataFrame.assign, force_error_N=error))]


def measure_roughness(distances: FloatArray, force: FloatArray) -> tuple[float, bool] | None:
    """Measure the noise of a force curve over ascending distances (m); None below nine of them or without force.

    Its robust standard deviation as a share of the force, and whether that is noise: where the spread still changes
    with the order it is the curvature of a coarse grid, and only an upper bound.
    """
    if len(distances) < MIN_DISTANCES or not np.any(force):
        return None
    x, y = even_scale(distances), np.log(np.maximum(np.abs(force), 1e-6 * np.abs(force).max()))
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
    robust = float(robust_deviation(contrasts))
    return float(np.sqrt(np.mean(contrasts[np.abs(contrasts) <= 3 * robust] ** 2)))


def reciprocity(points: pd.DataFrame, _model: Expected | None) -> list[Finding]:
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
    error = abs(factor - 1)
    if loops == 0:
        return [finding("reciprocity still")]
    if spread >= _SAME_SHAPE:
        return [finding("reciprocity shape", size=spread, factor=factor, percent=100 * spread, loops=loops)]
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
    spread = float(robust_deviation(ratios - factor) / abs(factor)) if factor else np.inf
    return factor, spread, int(keep.sum())


def _blocks(count: int) -> list[IntArray]:
    """Indices of an axis at its ends, and at the ends of its halves, quarters and eighths."""
    return [np.unique(np.linspace(0, count - 1, pieces + 1).round().astype(int)) for pieces in (1, 2, 4, 8)]


ROW_CHECKS: tuple[Check, ...] = (incomplete_rows, solved_sizes)
"""Of an imported table's rows, before its grid is looked at."""

GRID_CHECKS: tuple[Check, ...] = (reciprocity, gaps, force_noise)
"""Of a grid on which each point stands once, and whose force counts as it shall."""
