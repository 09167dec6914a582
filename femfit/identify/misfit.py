"""How far a model is from the readings: per channel before and after, averaged over the settings, and as curves.

The error is, for every command, file, report and picture, the root mean square per channel of recorded minus predicted
over all readings that were used, in the channel's unit. No run's or mount's freedom is taken out of it. Averages and
curves are what an engineer expects to see first: measured points on the model's curves, before and after.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.numerics import FloatArray, IntArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.identify.observations import Observations
from femfit.identify.settings import currents_in
from femfit.identify.words import sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of


@dataclass(frozen=True)
class ChannelFall:
    """The error of one channel before and after."""

    channel: str
    readings: int
    # Root mean square of recorded minus predicted, in the channel's unit
    rms_before: float
    rms_after: float
    noise: float | None  # Standard deviation of one reading, from repeats or as declared; None where neither says it
    magnitude: float | None = None  # Of impedances: |Z| in the channel's unit at which all of them are given

    @property
    def before_over_noise(self) -> float | None:
        """The error before, in standard deviations of one reading."""
        return None if self.noise is None else self.rms_before / self.noise

    @property
    def after_over_noise(self) -> float | None:
        """The error after, in standard deviations of one reading."""
        return None if self.noise is None else self.rms_after / self.noise

    def __str__(self) -> str:
        return sentence("parts", "fall", self)


@dataclass(frozen=True)
class ErrorFall:
    """The fall of the error in every channel that was compared."""

    channels: tuple[ChannelFall, ...]

    def __str__(self) -> str:
        return "\n".join(str(channel) for channel in self.channels)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, channel by channel, with the errors over the noise."""
        names = ("readings", "rms_before", "rms_after", "noise", "before_over_noise", "after_over_noise")
        return {
            channel.channel: {name: getattr(channel, name) for name in names}
            | ({"magnitude": channel.magnitude} if channel.magnitude else {})
            for channel in self.channels
        }

    @property
    def rms_before(self) -> dict[str, float]:
        """The error before, by channel."""
        return {channel.channel: channel.rms_before for channel in self.channels}

    @property
    def rms_after(self) -> dict[str, float]:
        """The error after, by channel."""
        return {channel.channel: channel.rms_after for channel in self.channels}


def error_fall(
    observations: Observations, before: FloatArray, after: FloatArray, noise: Mapping[str, float]
) -> ErrorFall:
    """The fall of the error between two predictions of the same readings, both of shape (M,) and in their units."""
    first, last = (observations.rms(observations.value - prediction) for prediction in (before, after))
    counts, magnitude = np.bincount(observations.channel, minlength=len(first)).tolist(), observations.magnitude
    return ErrorFall(
        tuple(
            ChannelFall(name, count, first[name], last[name], noise.get(name), magnitude.get(name))
            for name, count in zip(observations.channels, counts, strict=True)
        )
    )


PLANE = ("distance_m", "current_A")
LINES = ("frequency_Hz", "coil_temperature_C", "magnet_temperature_C", "order", "elapsed", "branch", "run", "mount")

_LEVELS = 24
"""Most levels that are kept apart; more are put into bins of equal counts."""

_BINS = 8
_CLOSE = 0.01
"""Levels closer than this part of the range are one that was met again."""


@dataclass(frozen=True, eq=False)
class MisfitMap:
    """Recorded minus predicted of one channel over one or two coordinates."""

    channel: str
    along: tuple[str, ...]
    cells: pd.DataFrame  # Coordinates, ``mean`` and ``rms`` in the channel's unit, and ``readings``

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data: one list a coordinate."""
        columns = {str(name): values.tolist() for name, values in self.cells.items()}
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
    coordinates = {name: observations.column(name)[here] for name in along}
    codes = [_bins(x, keep=name in {"run", "mount", "branch"}) for name, x in coordinates.items()]
    residual = observations.residual[here]
    rows = pd.DataFrame({**coordinates, "mean": residual, "rms": residual**2, "readings": 1})
    cells = rows.groupby(codes).agg(dict.fromkeys([*along, "mean", "rms"], "mean") | {"readings": "sum"})
    return MisfitMap(channel, along, cells.assign(rms=np.sqrt(cells["rms"])).reset_index(drop=True))


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
    after: Sequence[AddedEffect] = (),
    noise: dict[str, float] | None = None,
) -> tuple[MeasuredCurves, ...]:
    """The data of the picture, one for each channel: of the model, and with the effects after it was fitted."""
    misfits = [observations.residual, observations.value - observations.predict(after)]
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
        curves = [_curves(model, observations, name, (over, levels), (along, axis), e) for e in ((), after)]
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
    settings = {name: np.full(d.shape, np.median(observations.covariates[name])) for name in observations.currents}
    if "current_A" in grid:  # the currents of other circuits at their middle
        settings[observations.leading_current] = grid["current_A"].ravel()
    i = currents_in(model, pd.DataFrame(settings))
    conditions = Conditions(
        nominal_of(model),
        coil_temperature_C=float(observations.covariates["coil_temperature_C"].mean()),
        magnet_temperature_C=float(observations.covariates["magnet_temperature_C"].mean()),
        frequency_Hz=grid["frequency_Hz"].ravel() if "frequency_Hz" in grid else np.nan,
    )
    readings = predict_readings(model, d, i, conditions, (*model.effects, *effects), observations.channels)
    if channel not in readings:
        return np.zeros((0, len(along[1])))
    return np.asarray(readings[channel]).reshape(len(over[1]), len(along[1]))
