"""Adds a remainder to a model: learnt, checked on runs left out and in the filter, and beside every name."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from femfit.core.errors import MissingPartError
from femfit.core.numerics import FloatArray
from femfit.effects.catalogue import device_effects
from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.fall import error_fall
from femfit.identify.comparison.lack_of_fit import pattern_space
from femfit.identify.constants import COLUMN_STEP, LEAST_CHANGE
from femfit.identify.decision.campaign import guessed_noises
from femfit.identify.noise.whitening import Whitening
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.place import placed
from femfit.identify.refit.add_result import AddResult, Step
from femfit.identify.refit.checked_refit import channel_rms
from femfit.identify.refit.filter_fall import filter_fall
from femfit.identify.refit.refit import Start, fitted_together, refit
from femfit.identify.refit.sizes import EffectSize
from femfit.identify.remainder.constants import REFITTED, WORTH_A_REFIT
from femfit.identify.remainder.law import laws_of
from femfit.identify.remainder.learn import Checked, Learnt, learn_checked
from femfit.identify.remainder.parts import NAME, added, effect_of
from femfit.identify.remainder.result import RemainderResult, refutation, words_of
from femfit.identify.signatures import effect_columns, why_untestable
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import Measurement, TimeSeries


def without_remainder(model: ActuatorModel) -> ActuatorModel:
    """A model without a remainder that it has: one that is learnt anew takes its place."""
    others = [one for one in model.effects if one.effect.name != NAME]
    return model if len(others) == len(model.effects) else with_effects(model, others)


def add_remainder(
    model: ActuatorModel,
    measured: Measurement,
    whitening: Whitening,
    beside: AddResult | None = None,
    named: Collection[str] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> RemainderResult:
    """Learn what a model with all its effects leaves of the readings.

    Parameters
    ----------
    whitening : Whitening
        Of the readings beside this model.
    beside : AddResult or None
        What was added to it before.
    named : collection of str
        Effects of the model that are fitted to the same readings: what they can explain is left to them.
    """
    if model.without_effects.validity.further_A:
        raise MissingPartError(
            f"A remainder is learnt of a device with one circuit; model {model.name!r} has {len(model.circuits)}. Add "
            "effects by their names."
        )
    progress("Learning the remainder")
    checked = learn_checked(whitening, _columns_of(model, measured, named) if named else None)
    learnt, whitening = checked.learnt, checked.whitening
    parts = tuple(part.kind for part in learnt.coefficients)
    laws = laws_of(whitening, learnt)
    notes = {"law": "; ".join(f"{law.kind}: {law.text} ({law.share:.2f})" for law in laws)}
    effects = (added(effect_of(learnt.coefficients, words_of(laws, parts), notes)),) if parts else ()
    after = with_effects(model, (*model.effects, *effects))
    result = _result(model, after, effects, checked)
    result = replace(
        result,
        parts=parts,
        laws=laws,
        alternatives=learnt.alternatives,
        fall_unseen=checked.before.chi2 - checked.error.chi2,
        refutation=refutation(model, after, whitening.observations, whitening.noise) if parts else None,
        beside=beside,
    )
    if not parts:
        return result
    progress("Comparing it with every name")
    result = replace(result, named_instead=_as_good_name(whitening, learnt))
    if isinstance(measured, TimeSeries):
        progress("Running the filter over what was left out")
        fall = filter_fall(model, after, model.effects, measured, whitening.observations, checked.error.effects)
        result = replace(result, filter=fall)
    return result


def _columns_of(model: ActuatorModel, measured: Measurement, named: Collection[str]) -> FloatArray:
    """Change of every reading with each parameter of effects that a model has, shape (M, q)."""
    kept = [one for one in model.effects if one.effect.name not in named]
    fitted = [one for one in model.effects if one.effect.name in named]
    observations = placed(with_effects(model, kept), measured)
    base, columns = observations.predict(fitted), []
    for k, one in enumerate(fitted):
        for p in one.effect.parameters:
            step = COLUMN_STEP * p.width * (-1.0 if one.parameters[p.name] + COLUMN_STEP * p.width > p.upper else 1.0)
            moved = replace(one, parameters={**one.parameters, p.name: one.parameters[p.name] + step})
            columns.append((observations.predict([*fitted[:k], moved, *fitted[k + 1 :]]) - base) / step)
    return np.stack(columns, axis=1) if columns else np.zeros((len(base), 0))


def _result(
    model: ActuatorModel, after: ActuatorModel, effects: tuple[AddedEffect, ...], checked: Checked
) -> RemainderResult:
    whitening, learnt = checked.whitening, checked.learnt
    observations, noise = whitening.observations, whitening.noise
    predicted = observations.predict(effects) if effects else observations.base
    misfits = {"model": observations.residual} | ({NAME: observations.value - predicted} if effects else {})
    patterns = pattern_space(observations, whitening)
    return RemainderResult(
        model=after,
        added=effects,
        base=(),
        kept=tuple(one.effect.name for one in model.effects),
        fall=error_fall(observations, observations.base, predicted, noise.known),
        left_out=checked.error.rms,
        floor=noise.known,
        floor_source=noise.source,
        steps=tuple(Step(text, channel_rms(observations, misfit)) for text, misfit in misfits.items()),
        sizes=_sizes(observations, predicted - observations.base, learnt),
        suspicious=(),
        lack_of_fit_before=patterns.test(whitening.full(observations.residual)),
        lack_of_fit_after=patterns.test(whitening.full(observations.value - predicted), _freedom(whitening, learnt)),
        readings=len(observations.value),
        runs=len(np.unique(observations.column("run"))),
        observations=observations,
        findings=(*observations.findings, *guessed_noises(noise)),
    )


def _freedom(whitening: Whitening, learnt: Learnt) -> FloatArray | None:
    """Whitened directions that the readings decided more than the penalty did, shape (M, k)."""
    if not learnt.coefficients:
        return None
    columns = whitening.full(learnt.columns)
    left, size, _ = np.linalg.svd(columns @ np.linalg.cholesky(_positive(learnt.covariance)), full_matrices=False)
    return np.asarray(left[:, size**2 > 0.5])  # the share of a direction that the readings decide


def _positive(covariance: FloatArray) -> FloatArray:
    """A covariance that rounding has not made indefinite."""
    return covariance + 1e-10 * float(np.trace(covariance)) / len(covariance) * np.eye(len(covariance))


def _sizes(observations: Observations, change: FloatArray, learnt: Learnt) -> tuple[EffectSize, ...]:
    """The largest change of each channel within the data, with its 95 % interval."""
    result, half = [], float(stats.norm.isf(0.025))
    for c, channel in enumerate(observations.channels):
        here = np.flatnonzero(observations.channel == c)
        largest = float(np.abs(observations.base[here]).max())
        at = int(here[np.argmax(np.abs(change[here]))])
        if not learnt.coefficients or abs(change[at]) < LEAST_CHANGE * largest:
            continue
        row = learnt.columns[at]
        error = half * float(np.sqrt(max(row @ learnt.covariance @ row, 0.0)))
        size = float(change[at])
        place = (float(observations.column("distance_m")[at]), float(observations.column("current_A")[at]))
        result.append(
            EffectSize(NAME, channel, size, (size - error, size + error), size / largest if largest else None, *place)
        )
    return tuple(result)


def _as_good_name(whitening: Whitening, learnt: Learnt) -> str:
    """An effect of the catalogue that by itself is as likely as the remainder; empty where none is.

    Likelihoods with their price: of a name half of ln M a parameter (Schwarz, 1978), of the remainder its evidence.
    """
    observations, target = whitening.observations, whitening.full(whitening.observations.residual)
    found: list[tuple[float, list[Start]]] = []
    for effect in device_effects(observations.nominal.circuits, observations.nominal.drawn).values():
        if why_untestable(effect, observations):
            continue
        tries = [
            fitted_together(target, [Start.at_null(one, whitening)]) for one in effect_columns(effect, observations)
        ]
        if tries:
            starts, fall = max(tries, key=lambda one: one[1])
            found.append((fall, starts))
    best = sorted(found, key=lambda one: -one[0])[:REFITTED]
    return next((one[0].name for fall, one in best if _is_as_good(fall, one, whitening, target, learnt)), "")


def _is_as_good(fall: float, start: Sequence[Start], whitening: Whitening, target: FloatArray, learnt: Learnt) -> bool:
    if fall < WORTH_A_REFIT * 2.0 * learnt.evidence:
        return False
    fit = refit(whitening.observations, whitening, start)
    exact = float(target @ target) - fit.chi2
    return exact - len(fit.free) * float(np.log(len(target))) >= 2.0 * learnt.evidence
