"""A model before and after effects were added: its errors, how it runs, what is unusual, and what speaks against it.

Errors on readings that the effects were not fitted to: each run is left out in turn and they are fitted to the others,
without any linearisation.

References
----------
M. Stone, Journal of the Royal Statistical Society B 36 (1974) 111: cross-validation.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.results import Finding, Plotted, Result
from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.effects.words import titled, titles_of
from femfit.estimate.follow import followed
from femfit.identify.constants import FILTER_WORSE, HARMS, HELPS
from femfit.identify.lack_of_fit import LackOfFit, pattern_space
from femfit.identify.misfit import ErrorFall, beyond_noise, error_fall
from femfit.identify.noise.whitening import Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Refit, is_plausible, refit
from femfit.identify.words import printed
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import Measurement, TimeSeries, channel_words

COENERGY = "coenergy"
READINGS = ("force_N", "flux_linkage_Wb", "hall_V")
PARTS = {COENERGY: "a change of the co-energy over distance and current (force and flux linkage together)"} | {
    name: f"an error of the {channel_words(name)} over its own value" for name in READINGS
}
"""What a remainder may change."""


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
    parts : tuple of str, or None
        What a remainder, the effect ``unexplained``, changes: ``coenergy``, or the channel that is read wrongly; none
        where nothing beyond the noise is left, and None where none was sought.
    fall_unseen : float
        By how much the remainder lowers the weighted sum of squares on runs left out.
    beside : AddResult or None
        Effects that were added before the remainder.

    Examples
    --------
    >>> import femfit as ff
    >>> better = ff.add_effects(ff.read_model("model.json"), "bench.csv", "core_saturation")
    >>> force = better.fall.channels[0]
    >>> force.rms_after < force.rms_before
    True
    """

    _OF_ALL = (
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
    parts: tuple[str, ...] | None = None
    fall_unseen: float = 0.0
    beside: "AddResult | None" = None

    @property
    def accepted(self) -> bool:
        """Whether nothing speaks against the new model."""
        return not self.objections

    @property
    def objections(self) -> tuple[str, ...]:
        """What speaks against the new model: the error on runs left out, and what keeps it from running.

        ``risen``: that error is larger in some channel, and smaller in none or no size is certain; ``inductance``: it
        is not positive everywhere, as it was before; ``lost``: the filter does not run through; ``filter``: the mean
        square of its innovations is farther from 1 by more than a factor. Of a remainder ``unseen``: the error does
        not fall;
        ``risen``: it is larger in some channel; ``nothing``: none was learnt, nor are effects beside it accepted. What
        keeps a model with these alone from running counts as well.
        """
        if self.parts == ():
            return () if self.beside and self.beside.accepted else ("nothing",)
        before, after = self.filter["mean_square"].values() if self.filter else (1.0, 1.0)
        farther = before and after and abs(np.log(after)) > abs(np.log(before)) + np.log(FILTER_WORSE)
        turned = self.inductance_H.get("after", 1.0) <= 0.0 < self.inductance_H["before"]
        begun = self.beside.objections if self.beside else ()
        falls = any(HARMS * self.left_out[channel.channel] < channel.rms_before for channel in self.fall.channels)
        tests = {
            "inductance": turned or "inductance" in begun,
            "lost": after is None or "lost" in begun,
            "filter": farther,
            "unseen": self.parts is not None and self.fall_unseen <= HELPS,
            "risen": bool(self.risen) and (self.parts is not None or not falls or all(map(may_be_absent, self.added))),
        }
        return tuple(code for code, fails in tests.items() if fails)

    @property
    def risen(self) -> tuple[str, ...]:
        """Channels whose error on runs left out is larger than before."""
        channels = self.fall.channels
        return tuple(c.channel for c in channels if self.left_out[c.channel] > HARMS * c.rms_before)

    @property
    def data(self) -> tuple[str, ...]:
        """What programs read, without the model; of a remainder what it was learnt beside, too."""
        return self._OF_ALL if self.parts is None else (*self._OF_ALL, "remainder", "beside")

    @property
    def remainder(self) -> dict[str, Any]:
        """What was learnt beyond effects."""
        return {"parts": self.parts, "fall_unseen": self.fall_unseen}

    def __str__(self) -> str:
        text = printed("add", r=self) if self.parts is None else printed("remainder", r=self, words=PARTS)
        return titled(text, titles_of(self.observations.nominal.drawn))


def of_last_run(effects: Sequence[AddedEffect], observations: Observations) -> tuple[AddedEffect, ...]:
    """Effects that act in the last run, as a model has them whatever the run."""
    last = observations.runs - 1
    return tuple(replace(added, runs=None) for added in effects if added.runs is None or added.runs[1] == last)


def may_be_absent(added: AddedEffect) -> bool:
    """Whether no amplitude of an effect differs from none with 95 % confidence."""
    return all(min(ci := added.ci95.get(p.name, (p.null,))) <= p.null <= max(ci) for p in added.effect.amplitudes)


def suspicious_values(observations: Observations, fit: Refit) -> tuple[str, ...]:
    """What is unusual of fitted parameters, one sentence each."""

    def clocked(p: EffectParameter) -> EffectParameter:
        """A time with the unit that these data count it in."""
        unit = "s" if "time_s" in observations.given else "readings"
        return replace(p, unit=unit) if p.unit == "readings or s" else p

    every = [(added, p) for added in fit.effects for p in added.effect.parameters]
    stuck = [(fit.effects[k], p) for k, p in (fit.free[j] for j in np.flatnonzero(fit.active))]
    text = printed(
        "suspicious",
        fit=fit,
        unusual=[(added, clocked(p)) for added, p in every if not is_plausible(added, p)],
        ends=[(a, clocked(p)) for a, p in stuck if abs(a.parameters[p.name] - p.null) > 1e-3 * p.width],
        absent=[added.effect.name for added in fit.effects if may_be_absent(added)],
        nominal=observations.nominal,
        alone=lambda added, p: AddedEffect(added.effect, added.effect.null() | {p.name: added.parameters[p.name]}),
    )
    return tuple(text.splitlines())


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


def unseen_error(whitening: Whitening, fit: Refit) -> dict[str, float]:
    """Rms of recorded minus predicted per channel on runs left out, the effects of a fit fitted to the others."""

    def fitted(keep: BoolArray) -> tuple[AddedEffect, ...]:
        readings = whitening.observations.select(keep)
        return refit(Whitening.granting(readings, whitening.noise), fit.restart).effects

    rms, _ = cross_validated(whitening, fitted)
    return rms


def cross_validated(
    whitening: Whitening, fitted: Callable[[BoolArray], tuple[AddedEffect, ...]]
) -> tuple[dict[str, float], float]:
    """The error on each run, or quarter of a single one, by effects fitted to the readings that stay, of shape (M,).

    The root mean square of recorded minus predicted per channel, and the weighted sum of squares over all noise,
    re-mounts and offsets.
    """
    observations = whitening.observations
    group = observations.column("run").astype(int)
    if len(np.unique(group)) == 1:  # four stretches of a single run
        order: FloatArray = observations.column("order")
        group = np.searchsorted(np.quantile(order, [0.25, 0.5, 0.75]), order)
    as_read, chi2 = np.zeros(len(group)), 0.0
    for number in np.unique(group):
        out = group == number
        unseen = observations.select(out)
        as_read[out] = unseen.value - unseen.predict(fitted(~out))
        white = Whitening(unseen, whitening.noise).full(as_read[out])
        chi2 += float(white @ white)
    return observations.rms(as_read), chi2
