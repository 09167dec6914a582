"""A recorded time series, as the contract's CSV gives it: one row a sample."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import pandas as pd

SERIES_CHANNELS = (
    "voltage_V",
    "current_A",
    "distance_m",
    "hall_V",
    "force_N",
    "coil_temperature_C",
    "magnet_temperature_C",
)
"""Columns that a time series may record; ``voltage_V`` is the commanded voltage, held until the next sample."""

SERIES_COLUMNS = ("run", "time_s", *SERIES_CHANNELS)
"""All columns of a time series."""


@dataclass(frozen=True, eq=False)
class TimeSeries:
    """A recorded time series, read and checked.

    Parameters
    ----------
    rows : DataFrame
        Every column of :data:`SERIES_COLUMNS` as float64, and ``segment``: rows of one segment follow each other on a
        clock that runs on without a gap. A reading that is missing, or that a check has set aside, is NaN.
    given : tuple of str
        The columns that the file has with at least one number.
    declared_noise : mapping of str to float
        Standard deviation of a channel's sample from the sidecar, in the channel's unit.
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
    source: str = "time series"
    test_object: str = ""
    notes: str = ""

    @property
    def channels(self) -> tuple[str, ...]:
        """The recorded channels that the file has."""
        return tuple(name for name in SERIES_CHANNELS if name in self.given)
