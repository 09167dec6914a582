"""Which effect is missing, or none, or none of ours: the whole diagnosis of a measurement, and what it says."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from femfit.core.results import Finding, Plotted, Result
from femfit.effects.catalogue import device_effects, known_effect
from femfit.effects.words import smallest_visible, titled, titles_of
from femfit.identify.bench import placed
from femfit.identify.constants import CERTAIN, LEVEL
from femfit.identify.decision.campaign import Campaign, considered_effects, detectable_magnitudes, gather
from femfit.identify.decision.naming import Decision, decide, look_alikes
from femfit.identify.decision.remarks import (
    NamedEffect,
    ScoredEffect,
    campaign_remarks,
    creeping_zeros,
    named_effects,
    ranking_of,
    scored,
    stage_errors,
)
from femfit.identify.lack_of_fit import Where, where_it_fails
from femfit.identify.misfit import ErrorFall, allowed, error_fall, sweep_words
from femfit.identify.noise.whitening import NoiseModel
from femfit.identify.observations import Observations
from femfit.identify.refit import Refit
from femfit.identify.signatures import CHANGES_NOTHING
from femfit.identify.words import finding, printed, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.tables.measurement import Measurement


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Diagnosis(Plotted, Result, Decision):
    """The decision about a measurement with its words; printed, it is what ``femfit diagnose`` prints.

    Parameters
    ----------
    verdict : str
        ``nothing_missing``, ``named``, ``form_insufficient`` (the named effect is there, but its form leaves
        structure), ``unexplained`` (something is missing and none of the catalogue), ``compare_only`` (no verdict,
        since the noise is unknown or the readings are too few).
    where : Where
        Where the model fails before anything is added.
    error_fall : ErrorFall
        Error before, and with what is named.
    detectable : mapping of str to mapping of str to float
        Smallest magnitude of each effect's parameters that these data would have shown.
    probability : mapping of str to float
        Of each verdict but ``compare_only``.
    own_misfit : bool
        Whether the model misses the readings by more than noise, but as its misfit to its own table may.
    excess : float
        Squared length of the misfit beyond what noise gives, in standard deviations.
    look_alikes : tuple of str
        Effects, or constant errors of a channel, that would bear the same name on these data, had they been the cause
        and not been listed.
    confident : bool
        Whether the verdict is ``named``, without look-alikes among the effects considered, with every parameter in
        its plausible range. The drawing's dimensions are among the effects
        considered where ``dimensions_suspected`` says so.
    excluded : tuple of str
        Effects that were not considered: nothing is certain beside them.
    campaign : Campaign or None
        What the result rests on; None for ``compare_only``.

    Examples
    --------
    >>> import femfit as ff
    >>> diagnosis = ff.diagnose(ff.read_model("model.json"), "bench.csv")
    >>> diagnosis.verdict
    'named'
    """

    data = (
        *("verdict", "probability", "noise_floor", "noise", "detectable", "p_value", "look_alikes"),
        *("confident", "dimensions_suspected", "excluded", "missing", "ranking", "where", "error_fall"),
        *("lack_of_fit_before", "lack_of_fit_after", "findings", "rms=error_fall.rms_before"),
    )

    ranking: tuple[ScoredEffect, ...]
    where: Where
    error_fall: ErrorFall
    model: ActuatorModel
    observations: Observations
    missing: tuple[NamedEffect, ...] = ()
    detectable: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    excess: float = 0.0
    look_alikes: tuple[str, ...] = ()
    confident: bool = False
    excluded: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    campaign: Campaign | None = None

    @property
    def rivals(self) -> tuple[str, ...]:
        """What would give the same readings as one of the names."""
        return tuple(dict.fromkeys(name for effect in self.missing for name in effect.members[1:]))

    @property
    def dimensions_suspected(self) -> bool:
        """Whether numbers of the drawing were among the suspects, as a sweep with signatures gives them."""
        return bool(self.observations.nominal.drawn)

    @property
    def explanations(self) -> tuple[Refit, ...]:
        """What was named, then each other explanation that the data leave."""
        return tuple(explanation.fit for explanation in self.remaining if explanation.fit)

    @property
    def noise(self) -> NoiseModel | None:
        """Variances of the readings; None where they are unknown."""
        return self.campaign.noise if self.campaign else None

    @property
    def noise_floor(self) -> Mapping[str, float]:
        """Standard deviation of one reading per channel in which it is known."""
        return self.noise.known if self.noise else {}

    @property
    def allowed(self) -> Mapping[str, Any]:
        """What is granted of the errors with what is named."""
        return allowed(self.observations, self.noise, self.error_fall.rms_after)

    def __str__(self) -> str:
        after, nominal = self.allowed, self.observations.nominal
        effects, named = device_effects(nominal.circuits, nominal.drawn), {effect.name for effect in self.missing}
        hidden = {
            note: [score.name for score in self.ranking if score.note == note]
            for note in dict.fromkeys(score.note for score in self.ranking if score.note)
        }
        text = printed(
            "diagnosis",
            d=self,
            a=after,
            symptoms={effect.name: getattr(known_effect(effect.name), "symptom", "") for effect in self.missing},
            blind=hidden.get(CHANGES_NOTHING, []),  # it may be missing all the same, since it changes no reading
            **sweep_words(self.model),
            visible={
                name: smallest_visible(effects[name], amplitudes, nominal)
                for name, amplitudes in self.detectable.items()
                if name not in named
            },
            hidden=hidden,
        )
        return titled(text, titles_of(nominal.drawn))


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
    >>> diagnosis = ff.diagnose(ff.read_model("model.json"), "bench.csv")
    >>> diagnosis.verdict, [effect.name for effect in diagnosis.missing]
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
    considered, excluded = considered_effects(exclude, observations.nominal), tuple(dict.fromkeys(exclude))
    campaign = gather(observations, considered)
    if isinstance(campaign, Finding):
        return Diagnosis(
            verdict="compare_only",
            ranking=tuple(ScoredEffect(effect.name, 0.0, 0, note="no verdict") for effect in considered),
            where=Where("", (), "Without a test no misfit can be called one."),
            error_fall=error_fall(observations, observations.base, observations.base, observations.declared_noise),
            model=model,
            observations=observations,
            excluded=excluded,
            findings=(*observations.findings, campaign),
        )
    say("Scoring the effects")
    decision = decide(campaign)
    again = campaign.beside(decision.fit.effects) if decision.fit else None
    if again is not None:  # a large misfit looks like scatter of mounts and runs
        second = replace(decide(again), lack_of_fit_before=decision.lack_of_fit_before)
        campaign, decision = (again, second) if second.chosen else (campaign, decision)
    observations, noise, fit = campaign.observations, campaign.noise, decision.fit
    scores = scored(campaign)
    # What the patterns cannot see of an effect between them counts as well
    excess = max(campaign.patterns.excess(campaign.whitening.residual), *(s.chi2_fall for s in scores), 0.0)
    missing = named_effects(campaign, decision, fit, excess) if fit else ()
    alike = look_alikes(campaign, decision)
    remarks = campaign_remarks(campaign)
    visible = decision.p_value <= LEVEL  # what no test sees, anything would explain
    if visible and decision.verdict == "unexplained":
        remarks += stage_errors(campaign)
    if visible and decision.verdict in {"unexplained", "form_insufficient"}:
        remarks += creeping_zeros(campaign)
    if decision.posterior.ended:
        remarks.append(finding("search-ended", size=len(decision.fits), count=len(decision.fits)))
    fits = decision.verdict == "nothing_missing"
    where = Where("", (), "The model fits.") if fits else where_it_fails(observations, campaign.whitening)
    after = observations.predict(fit.effects if fit else ())
    sure = decision.verdict == "named" and not alike and decision.probability_of_chosen > CERTAIN
    sure = sure and "guess" not in noise.source.values() and all(named.plausible for named in missing)
    return Diagnosis(
        **vars(decision),
        missing=missing,
        ranking=ranking_of(campaign, decision, scores, excess),
        where=where,
        error_fall=error_fall(observations, observations.base, after, noise.known),
        detectable=detectable_magnitudes(campaign.effects),
        model=model,
        observations=observations,
        excess=excess,
        look_alikes=alike,
        confident=bool(sure and fit and fit.converged),
        excluded=excluded,
        findings=(*observations.findings, *remarks),
        campaign=campaign,
    )


def said_of(diagnosis: Diagnosis, what: str) -> str:
    """Its ``verdict`` in one sentence, or its ``certainty``: how far a name can be trusted against other causes."""
    return sentence("diagnosis", what, diagnosis, diagnosis.allowed)
