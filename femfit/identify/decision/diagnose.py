"""Which effect is missing, or none, or none of ours: the whole diagnosis of a measurement."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from femfit.core.results import Finding
from femfit.effects.words import describe
from femfit.identify.bench import placed
from femfit.identify.decision.campaign import (
    Campaign,
    campaign_remarks,
    considered_effects,
    detectable_magnitudes,
    explained_share,
    gather,
    stage_errors,
)
from femfit.identify.decision.constants import CERTAIN
from femfit.identify.decision.diagnosis import Diagnosis, NamedEffect, ScoredEffect
from femfit.identify.decision.evidence import score_effects
from femfit.identify.decision.naming import Decision, decide, look_alikes
from femfit.identify.misfit import error_fall
from femfit.identify.observations import Observations
from femfit.identify.refit import plausible
from femfit.identify.where import Where, where_it_fails
from femfit.identify.words import finding
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.tables.measurement import Measurement


def diagnose(
    model: ActuatorModel | str | Path,
    data: Measurement | str | Path,
    *,
    exclude: Sequence[str] = (),
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Compare measurements with a model and name the physical effect that is missing.

    Parameters
    ----------
    model : ActuatorModel or path
        Best the co-energy reference: a law's own misfit is found as missing physics.
    data : BenchTable or TimeSeries, or a path
        What was measured.
    exclude : sequence of str
        Effects that are not considered.

    Returns
    -------
    Diagnosis
        With the verdict ``compare_only`` where the noise of no channel is known, or the readings are too few.

    Raises
    ------
    TableError
        If no reading can be compared.

    Examples
    --------
    >>> found = ff.diagnose(ff.read_model("model.json"), "bench.csv")
    >>> found.verdict, [one.name for one in found.missing]
    ('named', ['coil_temperature', 'core_saturation'])
    """
    say = progress or (lambda _: None)
    say("Reading")
    model = model_of(model)
    return diagnose_observations(model, placed(model, data), exclude=exclude, say=say)


def diagnose_observations(
    model: ActuatorModel,
    observations: Observations,
    *,
    exclude: Sequence[str] = (),
    say: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Diagnose readings that stand beside their model."""
    say("Estimating the noise")
    campaign = gather(observations, considered_effects(exclude, observations.nominal))
    if isinstance(campaign, Finding):
        return _no_verdict(model, observations, campaign, exclude)
    say("Scoring the effects")
    decision = decide(campaign)
    fit = decision.chosen.fit if decision.chosen else None
    again = campaign.beside(fit.effects) if fit else None
    if again is not None:  # a large misfit looks like scatter of mounts and runs
        second = replace(decide(again), lack_of_fit=decision.lack_of_fit)
        campaign, decision = (again, second) if second.chosen else (campaign, decision)
    return replace(_diagnosis(model, campaign, decision), excluded=tuple(dict.fromkeys(exclude)))


def _diagnosis(model: ActuatorModel, campaign: Campaign, decision: Decision) -> Diagnosis:
    observations, fit = campaign.observations, decision.chosen.fit if decision.chosen else None
    after = observations.predict(fit.effects) if fit else observations.base
    scores = score_effects(campaign)
    # What the patterns cannot see of an effect between them counts as well
    excess = max(campaign.patterns.excess(campaign.whitening.residual), *(s.chi2_fall for s in scores), 0.0)
    missing = _named_effects(campaign, decision, excess)
    alike = look_alikes(campaign, decision)
    remarks = campaign_remarks(campaign)
    if decision.verdict == "unexplained":
        remarks += stage_errors(campaign)
    if decision.posterior.ended:
        remarks.append(finding("search-ended", size=len(decision.fits), count=len(decision.fits)))
    where = Where("", (), "The model fits.")
    if decision.verdict != "nothing_missing":
        where = where_it_fails(observations, campaign.whitening)
    return Diagnosis(
        verdict=decision.verdict,
        missing=missing,
        ranking=_ranking(campaign, decision, scores, excess),
        where=where,
        error_fall=error_fall(observations, observations.base, after, campaign.noise.known),
        noise_floor=campaign.noise.known,
        detectable=detectable_magnitudes(campaign),
        model=model,
        observations=observations,
        probability=decision.probability,
        p_value=decision.lack_of_fit.p_value,
        own_misfit=decision.own_misfit,
        excess=excess,
        lack_of_fit_before=decision.lack_of_fit,
        lack_of_fit_after=decision.left_after,
        look_alikes=alike,
        confident=bool(
            decision.verdict == "named"
            and not alike
            and decision.probability_of_chosen > CERTAIN
            and "guess" not in campaign.noise.source.values()
            and all(named.plausible for named in missing)
            and fit
            and fit.converged
        ),
        findings=(*observations.findings, *remarks),
        campaign=campaign,
        decision=decision,
    )


def _ranking(
    campaign: Campaign, decision: Decision, scores: tuple[ScoredEffect, ...], excess: float
) -> tuple[ScoredEffect, ...]:
    """Every effect as these data see it: those that were refitted as they were, the best first, then the others."""
    before, by_name = float(np.sum(campaign.whitening.residual**2)), {score.name: score for score in scores}
    alone = {names[0]: fit for names, fit in decision.fits.items() if len(names) == 1}
    observations, noise, refitted = campaign.observations, campaign.noise, []
    judged = np.array([name in noise.source for name in noise.channels])[observations.channel]
    for name, fit in alone.items():
        # Over the noise of one reading, as the fall of the error has it; all channels together
        residual = (observations.value - observations.predict(fit.effects)) / noise.sigma[observations.channel]
        share, error = explained_share(campaign, fit, excess), float(np.sqrt(np.mean(residual[judged] ** 2)))
        score = replace(by_name[name], chi2_fall=before - fit.chi2, explained_share=share, error_left=error)
        refitted.append(score)
    return (*refitted, *(score for score in scores if score.name not in alone))


def _named_effects(campaign: Campaign, decision: Decision, excess: float) -> tuple[NamedEffect, ...]:
    fit = decision.chosen.fit if decision.chosen else None
    if fit is None:
        return ()
    share, by_name = explained_share(campaign, fit, excess), {added.effect.name: added for added in fit.effects}
    exchanged = {frozenset(explanation.names): explanation.fit for explanation in decision.left if explanation.fit}
    nominal, result = campaign.observations.nominal, []
    for members, tie in zip(decision.classes, decision.ties, strict=True):
        added, beside = by_name[members[0]], set(fit.names) - {members[0]}
        refits = [exchanged.get(frozenset(beside | {name})) for name in tie[1:]]
        others = [next(a for a in each.effects if a.effect.name not in beside) if each else None for each in refits]
        named = NamedEffect(
            name=members[0],
            members=members,
            tie=tie,
            explained_share=share,
            parameters=dict(added.parameters),
            ci95=dict(added.ci95),
            words=tuple(describe(added, nominal)),
            tied_words=tuple(tuple(describe(effect, nominal)) if effect else () for effect in others),
            plausible=plausible(added),
            runs=None if added.runs is None else (added.runs[0] + 1, added.runs[1] + 1),
        )
        result.append(named)
    return tuple(result)


def _no_verdict(model: ActuatorModel, observations: Observations, why: Finding, exclude: Sequence[str]) -> Diagnosis:
    return Diagnosis(
        verdict="compare_only",
        ranking=tuple(
            ScoredEffect(effect.name, 0.0, 0, note="no verdict")
            for effect in considered_effects(exclude, observations.nominal)
        ),
        where=Where("", (), "Without a test no misfit can be called one."),
        error_fall=error_fall(observations, observations.base, observations.base, observations.declared_noise),
        model=model,
        observations=observations,
        excluded=tuple(dict.fromkeys(exclude)),
        findings=(*observations.findings, why),
    )
