"""Averages of recorded minus predicted over what was set and recorded: distance x current, temperature, time, run.

The picture that an engineer expects first: measured points on the model's curves, before and after, as arrays.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray, IntArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.identify.readings.observations import Observations
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of

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


_MOST_CURVES = 6
"""More curves than a legend holds at a glance are not drawn."""

_POINTS = 101


@dataclass(frozen=True, eq=False)
class MeasuredCurves:
    """Readings of one channel on the model's curves."""

    channel: str
    # Setting along the horizontal axis, ``distance_m`` or ``current_A``: the one that was set to more levels; of
    # impedances ``frequency_Hz``
    along: str
    over: str  # The other setting; each of its levels has a curve
    levels: FloatArray  # Settings ``over`` of the curves; shape (L,)
    axis: FloatArray  # Settings ``along`` of the curves; shape (K,)
    # The model's curves, in the channel's unit; no rows for a record over time, whose balances have no curve
    # shape (L, K)
    before: FloatArray
    after: FloatArray
    x: FloatArray  # Setting ``along`` of each reading; shape (n,)
    level: IntArray  # Curve nearest to each reading; shape (n,)
    # Each reading, and recorded minus predicted at its own settings; shape (n,)
    measured: FloatArray
    misfit_before: FloatArray
    misfit_after: FloatArray
    noise: float | None


def measured_curves(
    model: ActuatorModel,
    observations: Observations,
    before: Sequence[AddedEffect] = (),
    after: Sequence[AddedEffect] = (),
    noise: dict[str, float] | None = None,
) -> tuple[MeasuredCurves, ...]:
    """The data of the picture, one for each channel."""
    misfits = [observations.value - observations.predict(effects) for effects in (before, after)]
    result = []
    for name in observations.channels:
        here = np.flatnonzero(observations.of(name))
        keys = ("frequency_Hz", "distance_m") if observations.of_impedances else ("distance_m", "current_A")
        settings = {key: observations.column(key)[here] for key in keys}
        along, over = keys
        if not observations.of_impedances:
            along, over = sorted(settings, key=lambda key: -len(_levels(settings[key], 400)))
        scale = 1.0 if observations.weight is None else 1.0 / observations.weight[here]
        levels = _levels(settings[over], 40)
        if len(levels) > _MOST_CURVES:
            levels = np.quantile(settings[over], np.linspace(0.0, 1.0, _MOST_CURVES))
        spaced = np.geomspace if along == "frequency_Hz" else np.linspace
        axis = spaced(settings[along].min(), settings[along].max(), _POINTS)
        curves = [_curves(model, observations, name, (over, levels), (along, axis), e) for e in (before, after)]
        result.append(
            MeasuredCurves(
                channel=name,
                along=along,
                over=over,
                levels=levels,
                axis=axis,
                before=curves[0],
                after=curves[1],
                x=settings[along],
                level=np.argmin(np.abs(settings[over][:, None] - levels), axis=1),
                measured=scale * observations.value[here],
                misfit_before=scale * misfits[0][here],
                misfit_after=scale * misfits[1][here],
                noise=None if name in observations.magnitude else (noise or {}).get(name),
            )
        )
    return tuple(result)


def _levels(x: FloatArray, parts: int) -> FloatArray:
    """Settings that were brought to about the same value, a part of the range apart, as their means."""
    ordered = np.sort(x)
    group = np.concatenate([[0], np.cumsum(np.diff(ordered) > np.ptp(x) / parts)])
    return np.asarray(np.bincount(group, ordered) / np.bincount(group))


def _curves(
    model: ActuatorModel,
    observations: Observations,
    channel: str,
    over: tuple[str, FloatArray],
    along: tuple[str, FloatArray],
    effects: Sequence[AddedEffect],
) -> FloatArray:
    """The channel over both settings at the mean of the recorded temperatures, between the branches."""
    grid = dict(zip((over[0], along[0]), np.meshgrid(over[1], along[1], indexing="ij"), strict=True))
    d = grid["distance_m"].ravel()
    i = grid.get("current_A", np.full(d.shape, observations.covariates["current_A"].median())).ravel()
    if len(observations.currents) > 1:  # the others at their middle
        names, leading = observations.currents, observations.leading_current
        middle = {name: float(np.median(observations.covariates[name])) for name in names}
        i = np.stack([i if name == leading else np.full(i.shape, middle[name]) for name in names], axis=1)
    conditions = Conditions(
        nominal_of(model),
        coil_temperature_C=_mean(observations, "coil_temperature_C"),
        magnet_temperature_C=_mean(observations, "magnet_temperature_C"),
        frequency_Hz=grid["frequency_Hz"].ravel() if "frequency_Hz" in grid else np.nan,
    )
    readings = predict_readings(model, d, i, conditions, (*model.effects, *effects), observations.channels)
    if channel not in readings:
        return np.zeros((0, len(along[1])))
    return np.asarray(readings[channel]).reshape(len(over[1]), len(along[1]))


def _mean(observations: Observations, name: str) -> float:
    recorded = observations.covariates[name].to_numpy()
    recorded = recorded[np.isfinite(recorded)]
    return float(recorded.mean()) if len(recorded) else np.nan
