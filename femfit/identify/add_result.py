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
from femfit.identify.misfit import ErrorFall, beyond_noise, error_fall
from femfit.identify.noise.whitening import Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Refit, is_plausible
from femfit.identify.words import Result, printed
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import Measurement, TimeSeries


def suspicious_values(observations: Observations, fit: Refit) -> tuple[str, ...]:
    """What is unusual of fitted parameters, one sentence each."""
    nominal = observations.nominal
    unusual = [
        (a, _clocked(p, observations)) for a in fit.effects for p in a.effect.parameters if not is_plausible(a, p)
    ]
    stuck = [fit.free[j] for j in np.flatnonzero(fit.active)]
    ends = [
        (fit.effects[k], _clocked(p, observations))
        for k, p in stuck
        if abs(fit.effects[k].parameters[p.name] - p.null) > 1e-3 * p.width
    ]
    limits = {
        a.effect.name: [(p.null, a.ci95.get(p.name, (p.null,))) for p in a.effect.amplitudes] for a in fit.effects
    }
    absent = [name for name, known in limits.items() if all(min(ci) <= null <= max(ci) for null, ci in known)]
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
        and ``after``, None where it no longer runs through; None of a bench table, and where the model had no filter
        for the record.
    inductance_H : dict of str to float
        Least inductance over the validity domain ``before`` and ``after``, of several circuits the least eigenvalue.

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
        *("objections", "error_fall=fall", "coil_temperature_C=model.coil_temperature_C"),
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
    filter: Mapping[str, Mapping[str, float | None]] | None = None
    inductance_H: Mapping[str, float] = field(default_factory=dict)

    @property
    def accepted(self) -> bool:
        """Whether nothing speaks against the new model."""
        return not self.objections

    @property
    def objections(self) -> tuple[str, ...]:
        """What speaks against the new model: :attr:`worse`, and what keeps it from running that did not before.

        ``inductance``: it is not positive everywhere; ``lost``: the filter does not run through; ``filter``: the mean
        square of its innovations is farther from 1 by more than a factor.
        """
        before, after = self.filter["mean_square"].values() if self.filter else (1.0, 1.0)
        farther = before and after and abs(np.log(after)) > abs(np.log(before)) + np.log(FILTER_WORSE)
        turned = self.inductance_H.get("after", 1.0) <= 0.0 < self.inductance_H["before"]
        tests = {"inductance": turned, "lost": after is None, "filter": farther} | self.worse
        return tuple(code for code, fails in tests.items() if fails)

    @property
    def worse(self) -> dict[str, bool]:
        """Whether the error on runs left out has ``risen`` in some channel and falls in none."""
        helps = any(HARMS * self.left_out[channel.channel] < channel.rms_before for channel in self.fall.channels)
        return {"risen": bool(self.risen) and not helps}

    @property
    def risen(self) -> tuple[str, ...]:
        """Channels whose error on runs left out is larger than before."""
        channels = self.fall.channels
        return tuple(c.channel for c in channels if self.left_out[c.channel] > HARMS * c.rms_before)

    def __str__(self) -> str:
        return titled(printed("add", r=self), titles_of(self.observations.nominal.drawn))


def run_facts(before: ActuatorModel, after: ActuatorModel, measured: Measurement) -> dict[str, Any]:
    """The fields of a result that say how the models run: inductances, and of a record the filters."""
    models = {"before": before, "after": after}
    facts: dict[str, Any] = {"inductance_H": {name: model.smallest_inductance_H for name, model in models.items()}}
    first, last = (followed(m, measured) if isinstance(measured, TimeSeries) else None for m in models.values())
    if first is not None:
        ran = last if last and (last.lost_at_s is None or first.lost_at_s is not None) else None
        facts["filter"] = {"mean_square": {"before": first.mean_square, "after": ran and ran.mean_square}}
    return facts


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
    patterns, fall = pattern_space(whitening), error_fall(observations, first, last, noise.known)
    return {
        "fall": fall,
        "floor": noise.known,
        "floor_source": noise.source,
        "lack_of_fit_before": patterns.test(whitening.full(observations.value - first)),
        "lack_of_fit_after": patterns.test(whitening.full(observations.value - last), fitted),
        "readings": len(observations.value),
        "runs": len(np.unique(observations.column("run"))),
        "observations": observations,
        "beyond_noise": beyond_noise(observations, noise, fall.rms_after),
    }
