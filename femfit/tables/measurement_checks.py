"""Checks of a bench table: order of measuring, copies, stuck channels, lone outliers."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.core.numerics import FloatArray, even_scale
from femfit.core.results import Finding
from femfit.core.sweep_columns import is_current
from femfit.core.text import counted
from femfit.tables.findings import finding
from femfit.tables.header import parts_of
from femfit.tables.measurement import BenchTable
from femfit.tables.outliers import isolated_outliers
from femfit.tables.time_series_checks import equal_stretches
from femfit.tables.units import suspected_by_size

_LEAST_STUCK = 8
"""Assumed: consecutive equal readings from which a channel may be stuck."""

USUAL_OUTLIERS = 0.02
"""Assumed: part of a channel that a loose contact or a slip may be; more are warned of."""

_FEW = 5
"""Assumed: other readings that show whether a channel has noise."""

_STUCK_CHANCE = 1e-3
"""Conventional: expected number of such stretches by chance, from how often repeats are equal."""

STILL_CURRENT = 0.005
"""Assumed: change of the current, over all of its range, that is the ammeter's and no step."""

_TURNS = 0.25
"""Assumed: turns over steps up to which currents were cycled; currents in random order turn at two steps of three."""

_BOTH = 0.1
"""Assumed: part of the rows whose steps must rise, and fall, and follow a step at the same distance."""

_SINGLE = 0.02
"""Assumed: steps back in a file, over its rows, up to which a clock was reset; more are a file sorted by something
else."""


def checked(table: BenchTable) -> BenchTable:
    """Set aside what cannot be right in a table, and suspect its units from the sizes of its numbers."""
    findings = suspected_by_size(table.rows)
    rows = table.rows
    for name in (name for name in table.channels if parts_of(name)[0] != "voltage_V"):  # which may be commanded
        values, stuck = _without_stuck(rows, name)
        findings += stuck
        rows = rows.assign(**{name: values})
    return replace(table, rows=rows, findings=(*table.findings, *findings))


def without_outliers(table: BenchTable, predicted: Mapping[str, FloatArray]) -> BenchTable:
    """Set aside single readings whose deviation from a model contradicts that of all neighbours.

    Without a model a steep curve's true end looks like an outlier, so that readings are compared by what the model,
    channel by channel and row by row, leaves of them; NaN where it has no prediction.
    """
    rows, findings = table.rows, []
    for name in (name for name in table.channels if name in predicted):
        values = rows[name].to_numpy().copy()
        residual = values - predicted[name]
        readable = np.flatnonzero(np.isfinite(residual) & rows[["distance_m", "current_A"]].notna().all(axis=1))
        if len(readable) < 2:
            continue
        run = pd.factorize(rows["run"].to_numpy()[readable])[0]
        places, expected = _places(rows)[readable], predicted[name][readable]
        lone = readable[isolated_outliers(residual[readable], places, run, expected, _step(values[readable]))]
        if not len(lone):
            continue
        shown = "; ".join(
            f"{values[k]:.5g} at {1e3 * rows['distance_m'][k]:.4g} mm and {rows['current_A'][k]:.4g} A "
            f"(run {rows['run'][k]:g}, order {rows['order'][k]:g})"
            for k in lone[:3].tolist()
        ) + ("; and so on" if len(lone) > 3 else "")
        code = "outliers many" if len(lone) > USUAL_OUTLIERS * len(readable) else "outliers"
        findings.append(finding(code, size=float(len(lone)), column=name, readings=len(lone), shown=shown))
        values[lone] = np.nan
        rows = rows.assign(**{name: values})
    return replace(table, rows=rows, findings=(*table.findings, *findings))


def without_copies(rows: pd.DataFrame, columns: tuple[str, ...]) -> tuple[pd.DataFrame, list[Finding]]:
    """Keep rows once, where the same row stands twice: a file joined with itself would make the noise look smaller.

    Without numbers of run and order rows may be equal by chance, and are kept; but not where all of a table follows
    itself once more. Of a record whole segments are copies.
    """
    given = rows[list(columns)].reset_index(drop=True)
    copies = given.duplicated().to_numpy()
    if "segment" in rows:
        copies = pd.Series(copies).groupby(rows["segment"].to_numpy()).transform("all").to_numpy()
    elif not {"run", "order"} <= set(columns):
        as_first = (given == given.iloc[0]) | (given.isna() & given.iloc[0].isna())
        length = int(np.r_[np.flatnonzero(as_first.all(axis=1)), len(given)][1])
        before = given[: len(given) - length]
        pasted = _LEAST_STUCK <= length <= len(given) // 2 and given[length:].reset_index(drop=True).equals(before)
        numbers = before.to_numpy(dtype=np.float64).ravel()
        # Three digits may repeat by themselves
        pasted = pasted and any(float(f"{x:.3g}") != x for x in numbers[np.isfinite(numbers)])
        copies = (np.arange(len(given)) >= length) & pasted
    count = int(copies.sum())
    findings = [finding("copies", size=float(count), rows=count)] if count else []
    return rows[~copies].reset_index(drop=True), findings


def _without_stuck(rows: pd.DataFrame, name: str) -> tuple[FloatArray, list[Finding]]:
    """A channel without stretches of one and the same reading over settings that change, where others show its noise.

    Where a reading equals the one before with the chance p, n p^(L - 1) stretches of n readings are longer than L by
    chance. Without a current, where there is one elsewhere, what is computed may be constant; a reading of zero may be
    below the channel's step.
    """
    values = rows[name].to_numpy().copy()
    readable = np.flatnonzero(np.isfinite(values))
    read, rows = values[readable], rows.iloc[readable]
    length, stretch = equal_stretches(read, rows["run"].to_numpy())
    driven = (rows.filter(regex="^current_.*A$").fillna(0.0) != 0.0).any(axis=1).to_numpy()
    moves = (rows[_settings(rows)].diff().fillna(0.0) != 0.0).any(axis=1).to_numpy() & (driven | ~driven.any())
    steps = np.diff(read)[length[stretch[1:]] < _LEAST_STUCK]
    equal = (np.sum(steps == 0.0) + 1.0) / (len(steps) + 2.0)
    least = max(_LEAST_STUCK, 1.0 + np.log(_STUCK_CHANCE / max(len(read), 1)) / np.log(equal))
    long = np.bincount(stretch, moves & (read != 0.0), len(length)) >= least
    lengths_of: dict[float, list[int]] = {}
    for number in np.flatnonzero(long & (len(steps) >= _FEW)):
        members = np.flatnonzero(stretch == number)
        values[readable[members]] = np.nan
        lengths_of.setdefault(float(read[members[0]]), []).append(len(members))
    return values, [
        finding("stuck bench", size=float(sum(counts)), column=name, value=value, rows=" and ".join(map(str, counts)))
        for value, counts in lengths_of.items()
    ]


def _settings(rows: pd.DataFrame) -> list[str]:
    """The columns of a bench table that say at which setting a reading was taken."""
    return [str(name) for name in rows if is_current(str(name)) or name in {"distance_m", "branch", "frequency_Hz"}]


def _places(rows: pd.DataFrame) -> FloatArray:
    """Settings scaled to 0..1, the branches a little apart."""
    distance = rows["distance_m"].to_numpy()
    scaled = []
    for x in (even_scale(distance), rows["current_A"].to_numpy()):
        low, high = (np.nanmin(x), np.nanmax(x)) if np.isfinite(x).any() else (0.0, 0.0)
        scaled.append((x - low) / max(high - low, 1e-300))
    return np.column_stack([*scaled, 0.1 * rows["branch"].to_numpy()])


def _step(values: FloatArray) -> float:
    """A channel's quantisation: the smallest usual distance between the levels of a coarse channel, else 0."""
    levels = np.unique(values)
    return float(np.quantile(np.diff(levels), 0.1)) if 1 < len(levels) < 0.9 * len(values) else 0.0


def in_measuring_order(rows: pd.DataFrame, has_run: bool) -> tuple[pd.DataFrame, list[Finding]]:
    """Put rows of one run together, in the order of measuring: a believable one, else that of the file.

    ``order`` counts from 0 in a run where it is missing or not believable.
    """
    rows, findings = rows.copy(), []
    order = rows["order"].to_numpy()
    if not has_run and np.isfinite(order).all() and len(np.unique(order)) < len(order):
        rows["run"] = 1.0 + np.cumsum(np.diff(order, prepend=order[0]) < 0.0)
        if rows["run"].iloc[-1] > 1.0:
            findings.append(finding("order anew", column="order", times=int(rows["run"].iloc[-1] - 1)))
    pieces = []
    for run in pd.unique(rows["run"]):
        piece = rows[rows["run"] == run]
        moments, believable = _clock(piece["order"].to_numpy(), run)
        findings += moments
        if believable:
            piece = piece.sort_values("order", kind="stable")
        else:
            piece = piece.assign(order=np.arange(len(piece), dtype=np.float64))
        pieces.append(piece)
    return pd.concat(pieces, ignore_index=True), findings


def _clock(order: FloatArray, run: float) -> tuple[list[Finding], bool]:
    """What is odd about a run's order, and whether it can be sorted by."""
    if np.isnan(order).all():
        return [], False
    steps = np.diff(order)
    if np.isnan(order).any():
        return [finding("order gaps", column="order", run=run)], False
    back = np.flatnonzero(steps < 0.0)
    twice = len(order) - len(np.unique(order))
    numbered = bool(np.all(order == np.round(order)))
    if twice or (not numbered and 0 < len(back) <= max(1.0, _SINGLE * len(order))):
        what = f"goes back {counted(len(back), 'time')}" if len(back) else f"holds {counted(twice, 'number')} twice"
        return [finding("order reset", column="order", run=run, fault=what)], False
    return [], True


def branch_from_order(rows: pd.DataFrame) -> tuple[FloatArray | None, list[Finding]]:
    """Read the branch of every row from the order of measuring, where the currents of a table go up and down.

    +1 while the current rises, -1 while it falls, 0 where it does not change; None where it was not cycled.
    """
    current = rows["current_A"].to_numpy()
    still = STILL_CURRENT * float(np.nanmax(current) - np.nanmin(current)) if np.isfinite(current).any() else 0.0
    branch, turns, could_turn = np.zeros(len(rows)), 0, 0
    keys = rows[["run", "distance_m"]].to_numpy()
    breaks = np.flatnonzero((keys[1:] != keys[:-1]).any(axis=1)) + 1
    for place in np.split(np.arange(len(rows)), breaks):  # rows that follow each other in one run at one distance
        steps = np.diff(current[place])
        moved = np.flatnonzero(np.abs(steps) > still)
        if not len(moved):
            continue
        # A step's sign holds until the next step, and back to the stretch's first row
        signs = np.sign(steps[moved])
        turns += int(np.count_nonzero(np.diff(signs)))
        could_turn += len(moved) - 1
        before = np.searchsorted(moved, np.arange(len(place)) - 1, side="right") - 1
        branch[place] = signs[np.maximum(before, 0)]
    rising, falling = int(np.sum(branch > 0.0)), int(np.sum(branch < 0.0))
    # Rows in random order seldom make two steps on end at one distance, and then show no turns either
    if min(rising, falling, could_turn) < _BOTH * len(rows) or turns > _TURNS * (rising + falling):
        return None, []
    return branch, [finding("branch-assumed", column="branch")]
