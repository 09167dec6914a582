"""What adding effects to a model says: the new model, the effects' sizes, whether they are plausible, and the error."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.results import Finding, Plotted
from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.effects.words import titled, titles_of
from femfit.estimate.follow import followed
from femfit.identify.constants import FILTER_WORSE, HARMS
from femfit.identify.lack_of_fit import LackOfFit, pattern_space
from femfit.identify.misfit import ErrorFall, error_fall
from femfit.identify.noise.whitening import Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Refit, at_bounds, is_plausible
from femfit.identify.words import Result, printed
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import Measurement, TimeSeries


def suspicious_values(observations: Observations, fit: Refit) -> tuple[str, ...]:
    """What is unusual of fitted parameters, one sentence each."""
    nominal = observations.nominal
    unusual = [
        (a, _clocked(p, observations)) for a in fit.effects for p in a.effect.parameters if not is_plausible(a, p)
    ]
    ends = [(fit.effects[k], _clocked(p, observations)) for k, p in at_bounds(fit)]
    differs = {  # effects of which a fitted amplitude is not what it is without them
        added.effect.name
        for added in fit.effects
        for p in added.effect.amplitudes
        if p.name in added.ci95 and not added.ci95[p.name][0] <= p.null <= added.ci95[p.name][1]
    }
    absent = [name for name in fit.names if name not in differs]
    text = printed("suspicious", fit=fit, unusual=unusual, ends=ends, absent=absent, nominal=nominal, alone=_alone)
    return tuple(text.splitlines())


def _clocked(p: EffectParameter, observations: Observations) -> EffectParameter:
    """A time with the unit that these data count it in."""
    unit = "s" if "time_s" in observations.given else "readings"
    return replace(p, unit=unit) if p.unit == "readings or s" else p


def _alone(added: AddedEffect, p: EffectParameter) -> AddedEffect:
    """An effect with one of its parameters alone."""
    return AddedEffect(added.effect, added.effect.null() | {p.name: added.parameters[p.name]})


@dataclass(frozen=True, eq=False, repr=False)
class AddResult(Plotted, Result):
    """Effects added to a model; printed, it is what ``femfit add`` prints.

    Parameters
    ----------
    model : ActuatorModel
        With the effects, ready to be written.
    added : tuple of AddedEffect
        The effects that were fitted, in order, with 95 % intervals.
    kept : tuple of str
        Effects that the model had before and that these data cannot refit.
    fall : ErrorFall
        Error before and after, over all readings.
    left_out : mapping of str to float
        Root mean square per channel on readings that were not fitted: each run in turn, or quarters of a single run.
    floor : mapping of str to float
        Standard deviation of one reading, in the channels in which it is known.
    suspicious : tuple of str
        What is unusual of the fitted parameters, one sentence each.
    observations : Observations
        The readings beside the model without what was refitted.
    beyond_noise : mapping of str to float
        Channels whose error after is more than 1.2 times what declared noise, or repeats, show, in times the noise.
    filter : dict of str to dict, or None
        Mean square of the innovations of the model's filter, which should be 1, over a record's beginning ``before``
        and ``after``; None of a bench table, and where the model has no filter for the record.

    Examples
    --------
    >>> import femfit as ff
    >>> better = ff.add_effects(ff.read_model("model.json"), "bench.csv", "core_saturation")
    >>> force = better.fall.channels[0]
    >>> force.rms_after < force.rms_before
    True
    """

    data = (
        *("added", "kept", "left_out", "floor", "floor_source", "readings", "runs"),
        *("suspicious", "lack_of_fit_before", "lack_of_fit_after", "findings", "accepted", "beyond_noise", "filter"),
        *("error_fall=fall", "coil_temperature_C=model.coil_temperature_C"),
        "magnet_temperature_C=model.magnet_temperature_C",
    )

    model: ActuatorModel
    added: tuple[AddedEffect, ...]
    kept: tuple[str, ...]
    fall: ErrorFall
    left_out: Mapping[str, float]
    floor: Mapping[str, float]
    floor_source: Mapping[str, str]
    suspicious: tuple[str, ...]
    lack_of_fit_before: LackOfFit
    lack_of_fit_after: LackOfFit
    readings: int
    runs: int
    observations: Observations
    findings: tuple[Finding, ...] = ()
    beyond_noise: Mapping[str, float] = field(default_factory=dict)
    filter: Mapping[str, Mapping[str, float]] | None = None

    @property
    def accepted(self) -> bool:
        """Whether the error on runs left out falls somewhere, or rises nowhere, and the filter is not worse."""
        helps = any(HARMS * self.left_out[channel.channel] < channel.rms_before for channel in self.fall.channels)
        return (helps or not self.risen) and not self.filter_worse

    @property
    def filter_worse(self) -> bool:
        """Whether the mean square of the filter's innovations is farther from 1 than before by more than a factor."""
        before, after = np.abs(np.log([*self.filter["mean_square"].values()])) if self.filter else (0.0, 0.0)
        return bool(after > before + np.log(FILTER_WORSE))

    @property
    def risen(self) -> tuple[str, ...]:
        """Channels whose error on runs left out is larger than before."""
        channels = self.fall.channels
        return tuple(c.channel for c in channels if self.left_out[c.channel] > HARMS * c.rms_before)

    def __str__(self) -> str:
        return titled(printed("add", r=self), titles_of(self.observations.nominal.drawn))


def filter_fall(
    before: ActuatorModel, after: ActuatorModel, measured: Measurement
) -> Mapping[str, Mapping[str, float]] | None:
    """The mean square of innovations of both models' filters; None where there is no record or no filter for it."""
    if not isinstance(measured, TimeSeries):
        return None
    filters = {name: followed(model, measured) for name, model in (("before", before), ("after", after))}
    squares = {name: one_filter.mean_square for name, one_filter in filters.items() if one_filter is not None}
    return {"mean_square": squares} if len(squares) == len(filters) else None


def fit_facts(
    whitening: Whitening, before: Sequence[AddedEffect], after: Sequence[AddedEffect], fitted: FloatArray | None
) -> dict[str, Any]:
    """The fields of a result that follow from the readings, with the model's own effects before and all of them after.

    Parameters
    ----------
    fitted : array, shape (M, k), or None
        Whitened columns of what was fitted.
    """
    observations, noise = whitening.observations, whitening.noise
    first, last = observations.predict(before), observations.predict(after)
    patterns = pattern_space(whitening)
    return {
        "fall": error_fall(observations, first, last, noise.known),
        "floor": noise.known,
        "floor_source": noise.source,
        "lack_of_fit_before": patterns.test(whitening.full(observations.value - first)),
        "lack_of_fit_after": patterns.test(whitening.full(observations.value - last), fitted),
        "readings": len(observations.value),
        "runs": len(np.unique(observations.column("run"))),
        "observations": observations,
    }
