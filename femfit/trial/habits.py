"""What people do at a bench, and what they leave out of its file."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

Extent = Literal["usual", "three runs", "one channel", "few readings"]
Order = Literal["kept", "not written", "shuffled", "shuffled, not written"]

EXTENTS: Mapping[Extent, float] = {"usual": 0.6, "three runs": 0.15, "one channel": 0.15, "few readings": 0.1}
ORDERS: Mapping[Order, float] = {"kept": 0.6, "not written": 0.15, "shuffled": 0.125, "shuffled, not written": 0.125}
"""Parts of the campaigns."""

DECLARED = 0.5
"""Part of the campaigns whose noise stands beside the data."""


@dataclass(frozen=True)
class Habits:
    """How a campaign is measured and written down."""

    extent: Extent = "usual"
    order: Order = "kept"
    noise_declared: bool = False


def drawn_habits(rng: np.random.Generator) -> Habits:
    """Habits at random."""
    extent = list(EXTENTS)[int(rng.choice(len(EXTENTS), p=list(EXTENTS.values())))]
    order = list(ORDERS)[int(rng.choice(len(ORDERS), p=list(ORDERS.values())))]
    return Habits(extent, order, bool(rng.random() < DECLARED))


def written(rows: pd.DataFrame, habits: Habits, rng: np.random.Generator) -> pd.DataFrame:
    """The rows as their file has them: shuffled, and without a column of their order, where that is the habit."""
    if habits.order.startswith("shuffled"):
        rows = rows.iloc[rng.permutation(len(rows))].reset_index(drop=True)
    return rows.drop(columns="order") if habits.order.endswith("not written") else rows
