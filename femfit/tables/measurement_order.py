"""Puts the rows of a bench table into the order of measuring, and says where their clock is not to be believed."""

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray

_FEW = 0.02
"""Steps back in a file, over its rows, up to which a clock was reset; more are a file sorted by something else."""

_JUMP = 50.0
"""Usual steps from which a gap in the order is told."""


def in_measuring_order(rows: pd.DataFrame, has_run: bool) -> tuple[pd.DataFrame, list[str]]:
    """Rows of one run together, in the order of measuring.

    Parameters
    ----------
    rows : DataFrame
        ``run`` and ``order``, in the order of the file.
    has_run : bool
        Whether the file tells runs apart.

    Returns
    -------
    DataFrame
        Sorted by a believable order, else as in the file; ``order`` counts from 0 in a run where it is missing or
        not believable.
    list of str
        One plain sentence for each thing noticed.
    """
    rows, findings = rows.copy(), []
    order = rows["order"].to_numpy()
    if not has_run and np.isfinite(order).all() and len(np.unique(order)) < len(order):
        rows["run"] = 1.0 + np.cumsum(np.diff(order, prepend=order[0]) < 0.0)
        if rows["run"].iloc[-1] > 1.0:
            findings.append(
                f"order starts anew {rows['run'].iloc[-1] - 1:.0f} times; without a run column each stretch was taken "
                "as a run."
            )
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


def _clock(order: FloatArray, run: float) -> tuple[list[str], bool]:
    """What is odd about a run's order, and whether it can be sorted by."""
    if np.isnan(order).all():
        return [], False
    steps = np.diff(order)
    if np.isnan(order).any():
        return [f"order has gaps in run {run:g}; its rows were taken in the order of the file."], False
    back = np.flatnonzero(steps < 0.0)
    twice = len(order) - len(np.unique(order))
    counted = bool(np.all(order == np.round(order)))
    if twice or (not counted and 0 < len(back) <= max(1.0, _FEW * len(order))):
        what = f"goes back {len(back)} times" if len(back) else f"holds {twice} numbers twice"
        return [
            f"order {what} in run {run:g}: the clock was reset; its rows were taken in the order of the file."
        ], False
    steps = np.diff(np.sort(order))
    usual = float(np.median(steps)) if len(steps) else 0.0
    jumps = np.flatnonzero(steps > _JUMP * usual)
    if usual == 0.0 or not len(jumps):
        return [], True
    after, size = float(np.sort(order)[jumps[0]]), float(steps[jumps].max())
    return [f"order jumps by {size:g} after {after:g} in run {run:g}, where {usual:g} is usual."], True
