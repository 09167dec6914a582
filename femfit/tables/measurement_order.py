"""The order of measuring: rows sorted by it where it can be believed, and rising or falling current read from it."""

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray, IntArray
from femfit.core.finding import Finding

STILL_CURRENT = 0.005
"""Change of the current, over all of its range, that is the ammeter's and no step."""

_TURNS = 0.25
"""Turns over steps up to which currents were cycled; currents in random order turn at two steps of three."""

_BOTH = 0.1
"""Part of the steps that must rise, and fall."""

_FEW = 0.02
"""Steps back in a file, over its rows, up to which a clock was reset; more are a file sorted by something else."""

_JUMP = 50.0
"""Usual steps from which a gap in the order is told."""


def in_measuring_order(rows: pd.DataFrame, has_run: bool) -> tuple[pd.DataFrame, list[Finding]]:
    """Put rows of one run together, in the order of measuring.

    Parameters
    ----------
    has_run : bool
        Whether the file has a column of runs.

    Returns
    -------
    tuple of DataFrame and list of Finding
        Sorted by a believable order, else as in the file; ``order`` counts from 0 in a run where it is missing or
        not believable.
    """
    rows, findings = rows.copy(), []
    order = rows["order"].to_numpy()
    if not has_run and np.isfinite(order).all() and len(np.unique(order)) < len(order):
        rows["run"] = 1.0 + np.cumsum(np.diff(order, prepend=order[0]) < 0.0)
        if rows["run"].iloc[-1] > 1.0:
            times = f"{rows['run'].iloc[-1] - 1:.0f} times"
            findings.append(_said(f"order starts anew {times}; without a run column each stretch was taken as a run."))
    pieces = []
    for run in pd.unique(rows["run"]):
        piece = rows[rows["run"] == run]
        said, believable = _clock(piece["order"].to_numpy(), run)
        findings += said
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
        return [_said(f"order has gaps in run {run:g}; its rows were taken in the order of the file.")], False
    back = np.flatnonzero(steps < 0.0)
    twice = len(order) - len(np.unique(order))
    counted = bool(np.all(order == np.round(order)))
    if twice or (not counted and 0 < len(back) <= max(1.0, _FEW * len(order))):
        what = f"goes back {len(back)} times" if len(back) else f"holds {twice} numbers twice"
        text = f"order {what} in run {run:g}: the clock was reset; its rows were taken in the order of the file."
        return [_said(text)], False
    steps = np.diff(np.sort(order))
    usual = float(np.median(steps)) if len(steps) else 0.0
    jumps = np.flatnonzero(steps > _JUMP * usual)
    if usual == 0.0 or not len(jumps):
        return [], True
    after, size = float(np.sort(order)[jumps[0]]), float(steps[jumps].max())
    return [_said(f"order jumps by {size:g} after {after:g} in run {run:g}, where {usual:g} is usual.")], True


def _said(text: str) -> Finding:
    return Finding("order", "info", text, column="order")


def branch_from_order(rows: pd.DataFrame) -> tuple[FloatArray | None, list[Finding]]:
    """Read the branch of every row from the order of measuring, where the currents of a table go up and down.

    Returns
    -------
    array, shape (n,), or None
        +1 while the current rises, -1 while it falls, 0 where it does not change; None where it was not cycled.
    """
    current = rows["current_A"].to_numpy()
    still = STILL_CURRENT * float(np.nanmax(current) - np.nanmin(current)) if np.isfinite(current).any() else 0.0
    branch, turns = np.zeros(len(rows)), 0
    for place in _stretches(rows):
        steps = np.diff(current[place])
        known = np.flatnonzero(np.abs(steps) > still)
        if not len(known):
            continue
        # A step's sign holds until the next step, and back to the stretch's first row
        signs = np.sign(steps[known])
        turns += int(np.count_nonzero(np.diff(signs)))
        before = np.searchsorted(known, np.arange(len(place)) - 1, side="right") - 1
        branch[place] = signs[np.maximum(before, 0)]
    rising, falling = np.count_nonzero(branch > 0.0), np.count_nonzero(branch < 0.0)
    if min(rising, falling) < _BOTH * len(rows) or turns > _TURNS * (rising + falling):
        return None, []
    said = "There is no column branch; whether the current rose or fell was read from the order of the rows."
    remedy = "Give a column branch (+1 rising, -1 falling) if that is not the order of measuring."
    return branch, [Finding("branch-assumed", "info", said, remedy, column="branch")]


def _stretches(rows: pd.DataFrame) -> list[IntArray]:
    """Places of rows that follow each other in one run at one distance."""
    keys = rows[["run", "distance_m"]].to_numpy()
    breaks = np.flatnonzero((keys[1:] != keys[:-1]).any(axis=1)) + 1
    return np.split(np.arange(len(rows)), breaks)
