"""Rising or falling current, read from the order of measuring where a file has no column for it."""

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray, IntArray

STILL_CURRENT = 0.005
"""Change of the current, over all of its range, that is the ammeter's and no step."""

_TURNS = 0.25
"""Turns over steps up to which currents were cycled; currents in random order turn at two steps of three."""

_BOTH = 0.1
"""Part of the steps that must rise, and fall."""


def branch_from_order(rows: pd.DataFrame) -> tuple[FloatArray | None, list[str]]:
    """The branch of every row, where the currents of a table go up and down.

    Parameters
    ----------
    rows : DataFrame
        ``run, distance_m, current_A`` in the order of measuring.

    Returns
    -------
    array, shape (n,), or None
        +1 while the current rises, -1 while it falls, 0 where nothing tells; None where the currents were not cycled.
    list of str
        What was assumed, as one plain sentence.
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
    said = (
        "There is no column branch; rising and falling current were told apart by the order of the rows. Give a column "
        "branch (+1 rising, -1 falling) if that is not the order of measuring."
    )
    return branch, [said]


def _stretches(rows: pd.DataFrame) -> list[IntArray]:
    """Places of rows that follow each other in one run at one distance."""
    keys = rows[["run", "distance_m"]].to_numpy()
    breaks = np.flatnonzero((keys[1:] != keys[:-1]).any(axis=1)) + 1
    return np.split(np.arange(len(rows)), breaks)
