"""How far a model is from the readings: per channel before and after, what of it is granted, and as curves.

The error is, for every command, file, report and picture, the root mean square per channel of recorded minus predicted
over all readings that were used, in the channel's unit. No run's or mount's freedom is taken out of it. What a verdict
grants beside the noise of a reading are mounts, runs, stops, and the model's own misfit; its words stand in
``allowances.j2``. Curves are what an engineer expects to see first: measured points on the model's curves, before and
after.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.numerics import FloatArray, IntArray
from femfit.effects.conditions import TEMPERATURES, Conditions
from femfit.effects.effect import AddedEffect
from femfit.fit.ranking import is_coarse
from femfit.fit.words import note
from femfit.identify.constants import OWN_MISFIT
from femfit.identify.lack_of_fit import most_of_noise
from femfit.identify.noise.whitening import NoiseModel
from femfit.identify.observations import Observations
from femfit.identify.settings import currents_in
from femfit.identify.words import sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import LawMagnetics
from femfit.model.readings import Point, readings_by
from femfit.model.several_magnetics import NetworkMagnetics
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement import OF_RUNS


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

    @property
    def data(self) -> dict[str, Any]:
        """Channel by channel, with the errors over the noise."""
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


def allowed(observations: Observations, noise: NoiseModel | None, rms: Mapping[str, float]) -> dict[str, Any]:
    """What a verdict on errors grants: which are more than noise, and what the others may be taken for.

    Returns
    -------
    dict
        ``rms``, the errors that are judged, per channel in its unit, and of impedances their ``magnitude``, as of the
        readings; ``beyond``, as of :func:`beyond_noise`, and ``apart``, those of them that the model's own misfit does
        not make either; ``own``, the rms of that misfit per channel, and ``granted``, channels that have one;
        ``place``, from where to where the distance may differ; ``unknown``, channels whose noise nothing says, beside
        others; ``mount``, how that of mounts is known (``assumed``, ``declared``, ``estimated``, ``any``, or empty
        where they have no freedom); ``mount_m``; ``stop_m``, 0 where stops make less than the noise of one reading;
        ``stop``, how that is known; ``runs``, offsets of runs that are larger than the noise of one reading, and
        whether they were declared.
    """
    own_misfit, beyond = observations.rms(observations.tolerance), beyond_noise(observations, noise, rms)
    facts = {
        "rms": rms,
        "magnitude": observations.magnitude,
        "beyond": beyond,
        "apart": [name for name in beyond if rms[name] > OWN_MISFIT * own_misfit[name]],
        "own": own_misfit,
        "granted": [name for name, size in own_misfit.items() if size > 0.0],
        "place": "mount to mount" if "mount" in observations.given else "run to run",
    }
    if noise is None:
        return facts | {"unknown": (), "mount": "", "stop_m": 0.0, "runs": {}}
    any_distance = noise.mount_m >= np.ptp(observations.column("distance_m"))
    made = np.abs(noise.stop_m * observations.distance_slope) > noise.sigma[observations.channel]
    provenance = "declared" if "distance_m" in observations.declared_noise else "estimated"
    source = "any" if any_distance else "assumed" if noise.mount_assumed else provenance
    larger = {
        name: float(run) for name, run, sigma in zip(noise.channels, noise.run, noise.sigma, strict=True) if run > sigma
    }
    return facts | {
        "unknown": [name for name in observations.channels if name not in noise.source],
        "mount": source if noise.mount_m > 0.0 else "",
        "mount_m": noise.mount_m,
        "stop_m": noise.stop_m if made.any() else 0.0,
        "stop": provenance,
        "runs": {name: (run, OF_RUNS + name in observations.declared_noise) for name, run in larger.items()},
    }


def beyond_noise(observations: Observations, noise: NoiseModel | None, rms: Mapping[str, float]) -> dict[str, float]:
    """Channels whose rms error is more than their noise, and how many times the noise of one reading it is.

    Within the noise is what :func:`most_of_noise` grants; a guess of the noise grants nothing. A channel of unknown
    noise is in no list.
    """
    if noise is None:
        return {}
    return {
        name: rms[name] / float(sigma)
        for name, sigma, most in zip(noise.channels, noise.sigma, most_of_noise(observations, noise), strict=True)
        if name in noise.source and rms.get(name, 0.0) > most
    }


def sweep_words(model: ActuatorModel) -> dict[str, str]:
    """What to do about the sweep that a model was fitted to: nothing where its fit told nothing.

    ``finer`` says which settings to add, or is ``law`` where a model is none of the co-energy; ``coarse`` says that it
    may be what the model fails by, of one that is too coarse.
    """
    if isinstance(model.without_effects.magnetics, LawMagnetics | NetworkMagnetics):
        return {"finer": "law", "coarse": ""}
    between = model.misfit and model.misfit.between
    coarse = note("coarse_for_readings", between) if between and is_coarse(between) else ""
    return {"finer": note("to_be_added", between) if between else "", "coarse": coarse}


_MOST_CURVES = 6
"""More curves than a legend holds at a glance are not drawn."""

_POINTS = 101


@dataclass(frozen=True, eq=False)
class MeasuredCurves:
    """Readings of one channel on the model's curves."""

    channel: str
    along: str  # Setting along the horizontal axis: ``distance_m``; of impedances ``frequency_Hz``
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
    misfits = observations.residual, observations.value - observations.predict(after)
    keys = ("frequency_Hz", "distance_m") if observations.of_impedances else ("distance_m", "current_A")
    result = []
    for name in observations.channels:
        of_channel = np.flatnonzero(observations.of(name))
        settings = {key: observations.column(key)[of_channel] for key in keys}
        along, over = sorted(keys, key=lambda key: not np.ptp(settings[key]))
        levels = np.unique(np.quantile(settings[over], np.linspace(0.0, 1.0, _MOST_CURVES)).round(9))
        spaced = np.geomspace if along == "frequency_Hz" else np.linspace
        axis = spaced(settings[along].min(), settings[along].max(), _POINTS)
        grid = dict(zip((over, along), map(np.ravel, np.meshgrid(levels, axis, indexing="ij")), strict=True))
        point = _between_readings(model, observations, grid)
        curves = [
            readings_by(replace(point, effects=(*model.effects, *effects)), (), (name,)).get(name, np.zeros((1, 0)))
            for effects in ((), after)
        ]
        before, fitted = (values.reshape(-1, _POINTS) for values in curves)
        scale = 1.0 / observations.weight[of_channel]
        result.append(
            MeasuredCurves(
                channel=name,
                along=along,
                over=over,
                levels=levels,
                axis=axis,
                before=before,
                after=fitted,
                x=settings[along],
                level=np.argmin(np.abs(settings[over][:, None] - levels), axis=1),
                measured=scale * observations.value[of_channel],
                misfit_before=scale * misfits[0][of_channel],
                misfit_after=scale * misfits[1][of_channel],
                noise=None if name in observations.magnitude else (noise or {}).get(name),
            )
        )
    return tuple(result)


def _between_readings(model: ActuatorModel, observations: Observations, grid: Mapping[str, FloatArray]) -> Point:
    """The model at settings of a grid, the others in the middle, temperatures on average, between the branches."""
    covariates = observations.covariates
    settings = pd.DataFrame({**covariates[[*observations.currents]].median(), **grid})
    if "current_A" in grid:
        settings[observations.leading_current] = grid["current_A"]
    temperatures: dict[str, Any] = {name: float(covariates[name].mean()) for name in TEMPERATURES}
    conditions = Conditions(nominal_of(model), **temperatures, frequency_Hz=grid.get("frequency_Hz", np.nan))
    return Point(model, grid["distance_m"], currents_in(model, settings), conditions, ())
