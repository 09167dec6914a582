"""Adds effects to a model: a bounded refit to measurements, judged on runs left out.

Amplitudes of the base (the magnet's strength, the turns, the resistance) may be fitted beside the effects, held by a
prior of two per cent: without them an effect would mop up a base that is slightly off. They are used where they lower
the weighted error on runs left out.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from femfit.core.errors import TableError
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect, Effect
from femfit.effects.tolerances import TOLERANCE_SD, TOLERANCES
from femfit.identify.comparison.gate import pattern_space
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import NoiseModel, Whitening, chains_of
from femfit.identify.readings.load import measurement_observations
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.add_result import AddResult, Step
from femfit.identify.refit.add_size import effect_sizes, suspicious_values
from femfit.identify.refit.add_start import restart, starting_point, without_untold
from femfit.identify.refit.refit import Refit, Start, refit
from femfit.identify.refit.unseen import UnseenError, beside_random, channel_rms, floor_as_read, unseen_error
from femfit.identify.signatures.columns import why_untestable
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import Measurement

_HELPS = 9.0
"""Fall of the weighted error on runs left out from which the base's amplitudes are used: three standard deviations."""

_HARMS = 1.05
"""Rise of a channel's error on runs left out from which they are not, whatever the other channels gain by them."""

Observe = Callable[[ActuatorModel], Observations]


@dataclass(frozen=True)
class AddOptions:
    """How effects are added.

    Parameters
    ----------
    base : {"auto", "always", "never"}
        Whether the base's amplitudes are fitted beside the effects; ``auto`` where that helps on runs left out
        and makes no channel worse.
    coil_temperature_C, magnet_temperature_C : float or None
        At which the new model runs; None for the mean of what was recorded, or the model's own.
    """

    base: Literal["auto", "always", "never"] = "auto"
    coil_temperature_C: float | None = None
    magnet_temperature_C: float | None = None


@dataclass(frozen=True, eq=False)
class _Campaign:
    """Readings beside the model without what is refitted, and their noise."""

    observations: Observations
    noise: NoiseModel
    whitening: Whitening


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A refit and its error on runs left out."""

    fit: Refit
    error: UnseenError


def add_effects(
    model: ActuatorModel,
    data: Measurement | Observe,
    names: Sequence[str],
    options: AddOptions | None = None,
    progress: Callable[[str], None] | None = None,
) -> AddResult:
    """Refit a model with effects.

    Parameters
    ----------
    model : ActuatorModel
        Effects that it has already are refitted with the new ones where the data can show them.
    data : BenchTable or TimeSeries or callable
        As read; or a function that places any other measurement beside a model.
    names : sequence of str
        Effects of the catalogue in the order of adding; one that the model has already is refitted.

    Returns
    -------
    AddResult
        The new model and how far the error fell.

    Raises
    ------
    ModelFileError
        If no effect has a name.
    TableError
        If the data cannot show an effect, or do not tell their noise.
    """
    options, say = options or AddOptions(), progress or (lambda _: None)
    observe = data if callable(data) else (lambda m: measurement_observations(m, data))
    kept, given, new = _split(model, names, observe)
    campaign = _campaign(observe(with_effects(model, kept)))
    observations, noise, whitening = campaign.observations, campaign.noise, campaign.whitening
    wanted = [*(added.effect for added in given), *new]
    _require_testable(wanted, observations)
    say("Fitting the effects")
    start = starting_point(observations, whitening, wanted)
    partial = [unseen_error(observations, noise, start[:k]).rms for k in range(len(given) + 1, len(start))]
    fitted = _fitted(campaign, start)
    steps = [Step(effect.name, rms) for effect, rms in zip(new, [*partial, fitted.error.rms], strict=False)]
    say("Fitting the base beside them")
    fitted = _with_base(campaign, fitted, options)
    base = len(fitted.fit.effects) - len(start)
    if base or not new:
        steps.append(Step("base" if base else "refit", fitted.error.rms))
    first = unseen_error(observations, noise, (), otherwise=given)
    before, after = (observations.value - observations.predict(e) for e in (given, fitted.fit.effects))
    gate = pattern_space(observations, whitening)
    fit = fitted.fit
    sizes = effect_sizes(observations, fit)
    beside = {added.effect.name for added in fit.effects[:base]}
    return AddResult(
        model=with_effects(_at_temperature(model, observations, options), (*kept, *fit.effects)),
        added=fit.effects[base:],
        base=fit.effects[:base],
        kept=tuple(added.effect.name for added in kept),
        before=channel_rms(observations, beside_random(before, whitening)),
        after=channel_rms(observations, beside_random(after, whitening)),
        unseen_before=first.rms,
        unseen_after=fitted.error.rms,
        floor={name: noise.floor[name] for name in noise.channels if name in noise.source},
        floor_source=noise.source,
        as_read={
            "before": first.rms_as_read,
            "after": fitted.error.rms_as_read,
            "floor": floor_as_read(observations, noise),
        },
        steps=(Step("model", first.rms), *steps),
        sizes=sizes,
        suspicious=suspicious_values(fit, sizes, beside),
        gate_before=gate.test(whitening.full(before)),
        gate_after=gate.test(fit.rest, fit.jacobian[:, ~fit.active]),
        readings=len(observations.value),
        runs=len(np.unique(observations.column("run"))),
        findings=observations.findings,
    )


def _split(
    model: ActuatorModel, names: Sequence[str], observe: Observe
) -> tuple[tuple[AddedEffect, ...], tuple[AddedEffect, ...], list[Effect]]:
    """(effects that stay as they are, those that are refitted, those that are new).

    An effect of the model stays where these data cannot show it; one that the user names is never among those.
    """
    wanted = [effect_by_name(name) for name in dict.fromkeys(names)]
    own = model.effects
    bare = observe(with_effects(model, ()))
    named = {effect.name for effect in wanted}
    stays = [added.effect.name not in named and bool(why_untestable(added.effect, bare)) for added in own]
    kept = tuple(added for added, stay in zip(own, stays, strict=True) if stay)
    given = tuple(added for added, stay in zip(own, stays, strict=True) if not stay)
    present = {added.effect.name for added in given}
    return kept, given, [effect for effect in wanted if effect.name not in present]


def _campaign(observations: Observations) -> _Campaign:
    noise = estimate_noise(observations)
    if noise is None:
        raise TableError(
            "Without a noise floor nothing can be fitted: neither repeated settings nor a sidecar tell the noise of a "
            "channel. Measure some settings twice, or declare the noise in a .toml beside the data ([noise] "
            "force_N = 2e-4)."
        )
    return _Campaign(observations, noise, Whitening(observations, noise, chains_of(observations)))


def _require_testable(effects: Sequence[Effect], observations: Observations) -> None:
    for effect in effects:
        if reason := why_untestable(effect, observations):
            raise TableError(f"Effect {effect.name} cannot be fitted to these data: {reason}. {effect.experiment}")


def _fitted(campaign: _Campaign, start: Sequence[Start], prior_sd: Mapping[str, float] | None = None) -> _Fitted:
    fit = refit(campaign.observations, campaign.whitening, start, prior_sd=prior_sd)
    told = without_untold(fit)
    if any(len(one.amplitudes) < len(all_.amplitudes) for (one, _), all_ in zip(told, fit.start, strict=True)):
        fit = refit(campaign.observations, campaign.whitening, told, prior_sd=prior_sd)
    return _Fitted(fit, unseen_error(campaign.observations, campaign.noise, restart(fit), prior_sd))


def _with_base(campaign: _Campaign, alone: _Fitted, options: AddOptions) -> _Fitted:
    """The refit with the base's amplitudes beside the effects, where wanted."""
    observations = campaign.observations
    visible = [
        effect
        for effect in TOLERANCES
        if effect.name not in alone.fit.names and not why_untestable(effect, observations)
    ]
    if options.base == "never" or not visible:
        return alone
    start = [*starting_point(observations, campaign.whitening, visible, at_null=True), *restart(alone.fit)]
    together = _fitted(campaign, start, {effect.name: TOLERANCE_SD for effect in visible})
    helps = together.error.chi2 < alone.error.chi2 - _HELPS
    harms = any(rms > _HARMS * alone.error.rms[name] for name, rms in together.error.rms.items())
    return together if options.base == "always" or (helps and not harms) else alone


def _at_temperature(model: ActuatorModel, observations: Observations, options: AddOptions) -> ActuatorModel:
    """The model at the temperatures where it is to run."""

    def chosen(option: float | None, name: str, own: float) -> float:
        recorded = observations.covariates[name].to_numpy()
        recorded = recorded[np.isfinite(recorded)]
        if option is not None:
            return option
        return round(float(recorded.mean()), 1) if len(recorded) else own

    return replace(
        model,
        coil_temperature_C=chosen(options.coil_temperature_C, "coil_temperature_C", model.coil_temperature_C),
        magnet_temperature_C=chosen(options.magnet_temperature_C, "magnet_temperature_C", model.magnet_temperature_C),
    )
