"""A bench measurement table: one row a reading, as the contract's CSV gives it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

CHANNELS = ("force_N", "flux_linkage_Wb", "hall_V", "voltage_V")
"""Columns that a bench reads."""

SETTINGS: dict[str, float] = {
    "run": 1.0,
    "mount": np.nan,
    "order": np.nan,
    "current_A": np.nan,
    "distance_m": np.nan,
    "branch": 0.0,
    "coil_temperature_C": np.nan,
    "magnet_temperature_C": np.nan,
}
"""Columns that say where and when a reading was taken, with the value that stands for a missing column.

A missing ``mount`` is the run's number, a missing ``order`` the row's place in its run; a missing ``branch`` is
read from the order of the rows where the currents go up and down.
"""


@dataclass(frozen=True, eq=False)
class BenchTable:
    """A bench measurement, read and checked.

    Parameters
    ----------
    rows : DataFrame
        Every column of :data:`SETTINGS` and :data:`CHANNELS` as float64; a reading that is missing, or that a check has
        set aside, is NaN. Rows of one run stand together in the order of measuring.
    given : tuple of str
        The columns that the file has with at least one number.
    declared_noise : mapping of str to float
        Standard deviation of a channel's reading from the sidecar, in the channel's unit.
    findings : tuple of str
        What the checks noticed, one plain sentence each.
    source : str
        Name of the file, for messages.
    test_object, notes : str
        From the sidecar; empty where it does not say.
    """

    rows: pd.DataFrame
    given: tuple[str, ...]
    declared_noise: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[str, ...] = ()
    source: str = "measurement"
    test_object: str = ""
    notes: str = ""

    @property
    def channels(self) -> tuple[str, ...]:
        """The measured channels that the file has."""
        return tuple(name for name in CHANNELS if name in self.given)
