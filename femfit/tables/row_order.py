"""The order of a table's rows: as they were measured, with the current's branch, and a record's clock in segments."""

import numpy as np
import pandas as pd

from femfit.core.numerics import FloatArray, IntArray
from femfit.core.results import Finding
from femfit.core.text import amount, counted
from femfit.tables.findings import finding, refused

STILL_CURRENT = 0.005
"""Assumed: change of the current, over all of its range, that is the ammeter's and no step."""

_TURNS = 0.25
"""Assumed: turns over steps up to which currents were cycled; currents in random order turn at two steps of three."""

_BOTH = 0.1
"""Assumed: part of the rows whose steps must rise, and fall, and follow a step at the same distance."""

_SINGLE = 0.02
"""Assumed: steps back in a file, over its rows, up to which a clock was reset; more are a file sorted by something
else."""


_SHARE = 0.1
"""Conventional: part of the steps that stand still from which the stamps are coarse; fewer are single faults."""

_PAUSE = 5.0
"""Assumed: a step of the clock longer than this many times the usual longest (95 %) one is a gap."""


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
    for run, piece in rows.groupby("run", sort=False):
        order = piece["order"].to_numpy()
        back, twice = int(np.sum(np.diff(order) < 0.0)), len(order) - len(np.unique(order))
        numbered = bool(np.all(order == np.round(order)))
        gaps = np.isnan(order)
        if not gaps.any() and not twice and (numbered or not 0 < back <= max(1.0, _SINGLE * len(order))):
            pieces.append(piece.sort_values("order", kind="stable"))
            continue
        pieces.append(piece.assign(order=np.arange(len(piece), dtype=np.float64)))
        fault = f"goes back {counted(back, 'time')}" if back else f"holds {counted(twice, 'number')} twice"
        if not gaps.any():
            findings.append(finding("order reset", column="order", run=run, fault=fault))
        elif not gaps.all():
            findings.append(finding("order gaps", column="order", run=run))
    return pd.concat(pieces, ignore_index=True), findings


def branch_from_order(rows: pd.DataFrame) -> tuple[FloatArray | None, list[Finding]]:
    """Read the branch of every row from the order of measuring, where the currents of a table go up and down.

    +1 while the current rises, -1 while it falls, 0 where it does not change; None where it was not cycled.
    """
    current = rows["current_A"]
    # Rows that follow each other in one run at one distance
    place = (rows[["run", "distance_m"]].diff() != 0.0).any(axis=1).cumsum()
    steps = current.groupby(place).diff()
    signs = np.sign(steps.where(steps.abs() > STILL_CURRENT * (current.max() - current.min())))
    moved = signs.dropna()
    turns = int((moved.groupby(place).diff().fillna(0.0) != 0.0).sum())
    could_turn = len(moved) - place[moved.index].nunique()
    # A step's sign holds until the next step, and back to the place's first row
    branch = signs.groupby(place).ffill().groupby(place).bfill().fillna(0.0).to_numpy()
    rising, falling = int(np.sum(branch > 0.0)), int(np.sum(branch < 0.0))
    # Rows in random order seldom make two steps on end at one distance, and then show no turns either
    if min(rising, falling, could_turn) < _BOTH * len(rows) or turns > _TURNS * (rising + falling):
        return None, []
    return branch, [finding("branch-assumed", column="branch")]


def check_clock(rows: pd.DataFrame, source: str = "the record") -> tuple[IntArray, list[Finding]]:
    """Find where a clock jumps back, stands still or pauses, and number the segments between."""
    time, run = rows["time_s"].to_numpy(), rows["run"].to_numpy()
    step, same = np.diff(time), np.diff(run) == 0.0
    forward = step[same & (step > 0.0)]
    if not len(forward):
        raise refused("clock-stands", source=source, samples=len(rows), begin=time.min(), end=time.max())
    if (step[same] == 0.0).mean() > _SHARE:
        raise refused("coarse-stamps", source=source, step=amount(float(np.median(forward)), "s"))
    usual = float(np.quantile(forward, 0.95))
    back, pause = same & (step <= 0.0), same & (step > _PAUSE * usual)
    findings = []
    for where, fault in ((back, "does not run on"), (pause, "pauses")):
        if where.any():
            first = int(np.flatnonzero(where)[0])
            facts = {"places": int(where.sum()), "begin": time[first], "end": time[first + 1], "run": run[first]}
            findings.append(finding("clock", size=float(where.sum()), column="time_s", fault=fault, **facts))
    breaks = np.concatenate([[False], back | pause | ~same])
    return np.cumsum(breaks), findings
