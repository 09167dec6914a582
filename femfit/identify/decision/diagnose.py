"""Which effect is missing, or none, or none of ours: the whole diagnosis of one set of observations."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.finding import Finding
from femfit.effects.catalogue import all_effects
from femfit.effects.effect import Effect
from femfit.identify.comparison.where import where_it_fails
from femfit.identify.decision.confidence import look_alikes
from femfit.identify.decision.diagnosis import Diagnosis, NamedEffect, ScoredEffect, Where
from femfit.identify.decision.evidence import Evidence, gather
from femfit.identify.decision.magnitude import detectable_magnitudes, error_fall
from femfit.identify.decision.naming import Decision, Levels, decide
from femfit.identify.noise.simulated_noise import simulated_noise
from femfit.identify.readings.observations import Observations, bench_observations
from femfit.identify.refit.refit import Refit
from femfit.identify.signatures.candidate import Candidate
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import BenchTable

_NO_FLOOR = Finding(
    "no-noise-floor",
    "info",
    "Neither repeated settings nor a declared noise say how large the noise of a channel is, so nothing can be named.",
    "Measure some settings twice, or declare the noise in a .toml beside the data ([noise] force_N = 2e-4).",
)

Progress = Callable[[str], None]


@dataclass(frozen=True)
class DiagnosisOptions:
    """How a diagnosis is made.

    Parameters
    ----------
    bootstrap : int
        Clean campaigns simulated for the false-naming rate; 0 for none.
    """

    levels: Levels = field(default_factory=Levels)
    exclude: tuple[str, ...] = ()
    bootstrap: int = 40
    seed: int = 0


def diagnose_bench(
    model: ActuatorModel, table: BenchTable, options: DiagnosisOptions | None = None, progress: Progress | None = None
) -> Diagnosis:
    """Diagnose a bench table.

    Parameters
    ----------
    model : ActuatorModel
        Best the co-energy reference: a law's own shape error is found as missing physics.

    Raises
    ------
    TableError
        If no reading can be compared.
    """
    return diagnose(bench_observations(model, table), options, progress)


def diagnose(
    observations: Observations, options: DiagnosisOptions | None = None, progress: Progress | None = None
) -> Diagnosis:
    """Diagnose observations of any kind.

    Returns
    -------
    Diagnosis
        ``compare_only`` where neither repeats nor a sidecar tell the noise of any channel.
    """
    return examine(observations, options, progress).diagnosis


@dataclass(frozen=True, eq=False)
class Examination:
    """A diagnosis with what it rests on.

    Parameters
    ----------
    evidence : Evidence or None
        Noise and columns; None for ``compare_only``.
    decision : Decision or None
        With the refitted candidates; None for ``compare_only``.
    """

    diagnosis: Diagnosis
    evidence: Evidence | None
    decision: Decision | None

    @property
    def explanations(self) -> tuple[Refit, ...]:
        """What was named, then each other explanation that the data do not tell from it."""
        if self.decision is None or self.decision.chosen is None:
            return ()
        chosen = self.decision.chosen.fit
        listed = {name for members in self.decision.classes for name in members}
        rivals = (c.fit for c in self.decision.candidates if c.fit is not chosen and set(c.fit.names) <= listed)
        return (chosen, *(fit for fit in rivals if len(fit.names) == len(chosen.names)))


def examine(
    observations: Observations, options: DiagnosisOptions | None = None, progress: Progress | None = None
) -> Examination:
    """Diagnose observations and keep what the result rests on."""
    options, say = options or DiagnosisOptions(), progress or (lambda _: None)
    say("Estimating the noise")
    evidence = gather(observations, considered_effects(options.exclude))
    if evidence is None:
        return Examination(_compare_only(observations), None, None)
    say("Scoring the effects")
    detectable = detectable_magnitudes(evidence, options.levels.gate)
    decision = decide(evidence, options.levels)
    rate = None
    if options.bootstrap:
        say("Simulating clean campaigns")
        rate = false_naming_rate(evidence, options)
    alike = look_alikes(evidence, decision.chosen, decision.classes, options.levels.after) if decision.chosen else ()
    diagnosis = replace(_diagnosis(evidence, decision, detectable, rate), look_alikes=alike)
    sane = all(one.sane for one in diagnosis.missing)
    confident = decision.verdict == "named" and sane and not alike
    return Examination(replace(diagnosis, confident=confident), evidence, decision)


def considered_effects(exclude: Sequence[str] = ()) -> list[Effect]:
    """The catalogue without some effects."""
    return [effect for name, effect in all_effects().items() if name not in exclude]


def false_naming_rate(evidence: Evidence, options: DiagnosisOptions) -> float:
    """Share of clean campaigns in which something is named: a parametric bootstrap of the whole decision.

    Parameters
    ----------
    evidence : Evidence
        Settings and noise are taken from here; each campaign's noise model is estimated anew.
    """
    generator = np.random.default_rng(options.seed)
    named = 0
    for _ in range(options.bootstrap):
        clean = evidence.observations.base + simulated_noise(evidence.whitening, generator)
        again = evidence.of(evidence.observations.with_values(clean))
        named += decide(again, options.levels).verdict in {"named", "form_insufficient"}
    return named / options.bootstrap


def _diagnosis(
    evidence: Evidence, decision: Decision, detectable: dict[str, dict[str, float]], rate: float | None
) -> Diagnosis:
    observations, chosen = evidence.observations, decision.chosen
    falls = {
        c.fit.names[0]: error_fall(evidence, c.fit, decision.excess)
        for c in decision.candidates
        if len(c.fit.names) == 1
    }
    ranking = tuple(
        replace(score, error_fall=falls[score.name]) if score.name in falls else score for score in decision.scores
    )
    missing = _named_effects(evidence, decision, chosen) if chosen else ()
    after = observations.value - observations.predict(chosen.fit.effects) if chosen else observations.residual
    return Diagnosis(
        verdict=decision.verdict,
        missing=missing,
        ranking=ranking,
        where=where_it_fails(observations, evidence.whitening)
        if decision.verdict != "nothing_missing"
        else Where("", (), "The model fits."),
        noise_floor=evidence.noise.floor,
        rms=_rms(observations, observations.residual),
        rms_after=_rms(observations, after),
        detectable=detectable,
        false_naming_rate=rate,
        gate_before=decision.before,
        gate_after=chosen.gate if chosen else None,
        findings=observations.findings,
    )


def _named_effects(evidence: Evidence, decision: Decision, chosen: Candidate) -> tuple[NamedEffect, ...]:
    p_values = {score.name: score.p_value for score in decision.scores}
    total = error_fall(evidence, chosen.fit, decision.excess)
    by_name = {
        added.effect.name: (added, sane) for added, sane in zip(chosen.fit.effects, chosen.fit.sane, strict=True)
    }
    result = []
    for members in decision.classes:
        added, sane = by_name[members[0]]
        result.append(
            NamedEffect(
                name=members[0],
                members=members,
                p_value=p_values[members[0]],
                error_fall=total,
                parameters=dict(added.parameters),
                ci95=dict(added.ci95),
                sane=sane,
            )
        )
    return tuple(result)


def _rms(observations: Observations, residual: FloatArray) -> dict[str, float]:
    return {name: float(np.sqrt(np.mean(residual[observations.of(name)] ** 2))) for name in observations.channels}


def _compare_only(observations: Observations) -> Diagnosis:
    note = "no noise floor"
    return Diagnosis(
        verdict="compare_only",
        missing=(),
        ranking=tuple(ScoredEffect(effect.name, 1.0, 0.0, 0, note=note) for effect in considered_effects()),
        where=Where("", (), "Without a noise floor no misfit can be called one."),
        noise_floor={},
        rms=_rms(observations, observations.residual),
        rms_after=_rms(observations, observations.residual),
        detectable={},
        false_naming_rate=None,
        findings=(*observations.findings, _NO_FLOOR),
    )
