"""The picture that an engineer expects first: measured points on the model's curves, before and after, as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.identify.readings.observations import Observations
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of

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
