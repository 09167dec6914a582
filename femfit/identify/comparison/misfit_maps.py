"""Averages of recorded minus predicted over what was set and recorded: distance x current, temperature, time, run."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.identify.readings.observations import Observations

PLANE = ("distance_m", "current_A")
LINES = ("frequency_Hz", "coil_temperature_C", "magnet_temperature_C", "order", "elapsed", "branch", "run", "mount")

_LEVELS = 24
"""Most levels that are kept apart; more are put into bins of equal counts."""

_BINS = 8
_CLOSE = 0.01
"""Levels closer than this part of the range are one that was met again."""


@dataclass(frozen=True)
class MapCell:
    """One cell of a map."""

    at: tuple[float, ...]
    # Mean and rms of recorded minus predicted, in the channel's unit
    mean: float
    rms: float
    readings: int


@dataclass(frozen=True)
class MisfitMap:
    """Recorded minus predicted of one channel over one or two coordinates."""

    channel: str
    along: tuple[str, ...]
    cells: tuple[MapCell, ...]

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data: one list a coordinate."""
        columns = {name: [cell.at[k] for cell in self.cells] for k, name in enumerate(self.along)}
        for key in ("mean", "rms", "readings"):
            columns[key] = [getattr(cell, key) for cell in self.cells]
        return {"channel": self.channel, "along": list(self.along), **columns}


def misfit_maps(observations: Observations) -> tuple[MisfitMap, ...]:
    """The maps of every channel."""
    result = []
    for channel in observations.channels:
        here = np.flatnonzero(observations.of(channel))
        result.append(_map(observations, channel, here, PLANE))
        for name in (name for name in LINES if name in observations.covariates):
            values = observations.column(name)[here]
            if np.isfinite(values).all() and len(here) and np.ptp(values) > 0.0:
                result.append(_map(observations, channel, here, (name,)))
    return tuple(result)


def _map(observations: Observations, channel: str, here: IntArray, along: tuple[str, ...]) -> MisfitMap:
    coordinates = np.stack([observations.column(name)[here] for name in along])
    residual = observations.residual[here]
    codes = np.stack(
        [_bins(x, keep=name in {"run", "mount", "branch"}) for name, x in zip(along, coordinates, strict=True)]
    )
    _, cell = np.unique(codes, axis=1, return_inverse=True)
    return MisfitMap(channel, along, tuple(_cells(coordinates, residual, cell)))


def _cells(coordinates: FloatArray, residual: FloatArray, cell: IntArray) -> Iterable[MapCell]:
    count = np.bincount(cell)
    mean = np.bincount(cell, residual) / count
    rms = np.sqrt(np.bincount(cell, residual**2) / count)
    at = np.stack([np.bincount(cell, x) / count for x in coordinates])
    for k in range(len(count)):
        yield MapCell(tuple(float(v) for v in at[:, k]), float(mean[k]), float(rms[k]), int(count[k]))


def _bins(x: FloatArray, *, keep: bool) -> IntArray:
    """Number of each value's level, or of its bin where there are many levels."""
    levels = np.unique(x)
    start = np.concatenate([[True], np.diff(levels) > (0.0 if keep else _CLOSE * np.ptp(x))])
    number = (np.cumsum(start) - 1)[np.searchsorted(levels, x)]
    if keep or number.max() < _LEVELS:
        return np.asarray(number)
    edges = np.quantile(x, np.linspace(0.0, 1.0, _BINS + 1)[1:-1])
    return np.asarray(np.searchsorted(edges, x))
