"""Adds a remainder to a model: learnt, checked on runs left out and in the filter, and beside every name."""

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from femfit.core.errors import MissingPartError
from femfit.core.numerics import FloatArray
from femfit.effects.catalogue import device_effects
from femfit.identify.add_result import AddResult, EffectSize, fit_facts, largest_changes
from femfit.identify.bench import placed
from femfit.identify.decision.campaign import guessed_noises
from femfit.identify.filter_fall import filter_fall
from femfit.identify.noise.whitening import Whitening
from femfit.identify.refit import Start, fitted_together, refit
from femfit.identify.remainder.constants import REFITTED, WORTH_A_REFIT
from femfit.identify.remainder.learn import Learnt, learn_checked
from femfit.identify.remainder.parts import NAME, effect_of
from femfit.identify.remainder.result import RemainderResult, refutation, short_law, words_of
from femfit.identify.signatures import effect_columns, why_untestable
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import Measurement, TimeSeries


def without_remainder(model: ActuatorModel) -> ActuatorModel:
    """A model without a remainder that it has: one that is learnt anew takes its place."""
    effects = [effect for effect in model.effects if effect.effect.name != NAME]
    return model if len(effects) == len(model.effects) else with_effects(model, effects)


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
    if len(model.without_effects.validity.current_limits_A) > 1:
        raise MissingPartError(
            f"A remainder is learnt of a device with one circuit; model {model.name!r} has {len(model.circuits)}. Add "
            "effects by their names."
        )
    progress("Learning the remainder")
    checked = learn_checked(whitening, _columns_of(model, measured, named) if named else None)
    learnt, whitening = checked.learnt, checked.whitening
    parts = tuple(component.kind for component in learnt.coefficients)
    laws = tuple(short_law(whitening, learnt, part) for part in learnt.coefficients)
    notes = {"law": "; ".join(f"{law.kind}: {law.text} ({law.share:.2f})" for law in laws)}
    effects = (effect_of(learnt.coefficients, words_of(laws, parts), notes),) if parts else ()
    after = with_effects(model, (*model.effects, *effects))
    observations, stages = whitening.observations, [("model", ()), *([(NAME, effects)] if effects else [])]
    sizes: tuple[EffectSize, ...] = ()
    if effects:
        change = observations.predict(effects) - observations.base
        sizes = tuple(largest_changes(NAME, observations, change, learnt.every_column, learnt.covariance))
    result = RemainderResult(
        model=after,
        added=effects,
        base=(),
        kept=tuple(present.effect.name for present in model.effects),
        left_out=checked.error.rms,
        sizes=sizes,
        suspicious=(),
        findings=(*observations.findings, *guessed_noises(whitening.noise)),
        parts=parts,
        laws=laws,
        alternatives=learnt.alternatives,
        fall_unseen=checked.before.chi2 - checked.error.chi2,
        refutation=refutation(model, after, observations, whitening.noise) if parts else None,
        beside=beside,
        **fit_facts(whitening, stages, _decided(whitening, learnt)),
    )
    if not parts:
        return result
    progress("Comparing it with every name")
    result = replace(result, named_instead=_as_good_name(whitening, learnt))
    if isinstance(measured, TimeSeries):
        progress("Running the filter over what was left out")
        fall = filter_fall(model, after, model.effects, measured, observations, checked.error.effects)
        result = replace(result, filter=fall)
    return result


def _columns_of(model: ActuatorModel, measured: Measurement, named: Collection[str]) -> FloatArray:
    """Change of every reading with each parameter of effects that a model has, shape (M, q)."""
    staying = [effect for effect in model.effects if effect.effect.name not in named]
    fitted = [effect for effect in model.effects if effect.effect.name in named]
    observations = placed(with_effects(model, staying), measured)
    return observations.slopes(fitted, [(k, p.name) for k, one in enumerate(fitted) for p in one.effect.parameters])


def _decided(whitening: Whitening, learnt: Learnt) -> FloatArray | None:
    """Whitened directions that the readings decided more than the penalty did, shape (M, k)."""
    if not learnt.coefficients:
        return None
    columns, covariance = whitening.full(learnt.every_column), learnt.covariance
    # Rounding must not make it indefinite
    covariance = covariance + 1e-10 * float(np.trace(covariance)) / len(covariance) * np.eye(len(covariance))
    directions, size, _ = np.linalg.svd(columns @ np.linalg.cholesky(covariance), full_matrices=False)
    return np.asarray(directions[:, size**2 > 0.5])  # the share of a direction that the readings decide


def _as_good_name(whitening: Whitening, learnt: Learnt) -> str:
    """An effect of the catalogue that by itself is as likely as the remainder; empty where none is.

    Likelihoods with their price: of a name half of ln M a parameter (Schwarz, 1978), of the remainder its evidence.
    """
    observations, target = whitening.observations, whitening.residual
    candidates: list[tuple[list[Start], float]] = []
    for effect in device_effects(observations.nominal.circuits, observations.nominal.drawn).values():
        if not why_untestable(effect, observations):
            variants = Start.at_null(effect_columns(effect, observations), whitening)
            tries = [fitted_together(target, [variant]) for variant in variants]
            candidates += sorted(tries, key=lambda attempt: -attempt[1])[:1]
    for starts, fall in sorted(candidates, key=lambda candidate: -candidate[1])[:REFITTED]:
        if fall < WORTH_A_REFIT * 2.0 * learnt.evidence:
            continue
        fit = refit(whitening, starts)
        exact = float(target @ target) - fit.chi2
        if exact - len(fit.free) * float(np.log(len(target))) >= 2.0 * learnt.evidence:
            return starts[0].name
    return ""
