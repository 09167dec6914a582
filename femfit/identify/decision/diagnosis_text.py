"""A diagnosis in plain sentences: the verdict, its size, how certain it is, where it shows, and what it rests on.

Whether a lag is what the drawing predicts, in a sentence.

Where the current i changes slowly, eddy currents are e = -R^-1 C^T L di/dt. The field is that of i + C e, so that it
follows late by C R^-1 C^T L. What ``eddy_current_lag`` finds adds its own shares times their time constants.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.text import amount, counted, probability
from femfit.effects.catalogue import device_effects, known_effect
from femfit.effects.lags import EDDY_CURRENT_LAG, slow_lag
from femfit.effects.words import smallest_visible
from femfit.identify.constants import LEVEL_AFTER, WITHIN_NOISE
from femfit.identify.decision.own_misfit import (
    also_allowed,
    beyond_own_misfit,
    finer_model,
    granted_channels,
    own_misfit_sentence,
)
from femfit.identify.noise.scatter import allowed_for, beyond_noise, if_mounts_are_assumed, not_judged
from femfit.identify.readings.place import notes, suspicions
from femfit.identify.signatures import CHANGES_NOTHING
from femfit.tables.measurement import CHANNEL_WORDS

if TYPE_CHECKING:
    from femfit.identify.decision.diagnosis import Diagnosis, NamedEffect


def lag_lines(diagnosis: "Diagnosis", *, misses: bool) -> list[str]:
    """The sentence, where the drawing has eddy currents, the data show them, and the model misses nothing else.

    The conductivity of one of several materials changes the lag, too, but the model's states do not say by how much.
    """
    base = diagnosis.model.without_effects
    lags = {EDDY_CURRENT_LAG.name, *(one.key for one in base.drawn if one.conducts)}
    named = {one.name: one.parameters for one in diagnosis.missing if one.name in lags}
    alike = {name for one in diagnosis.missing for name in one.members if one.name not in lags}
    if base.eddy is None or len(base.circuits) != 1 or not (named or lags & diagnosis.detectable.keys()):
        return []
    parts = {one.key for one in base.drawn if one.key.endswith("conductivity_MS_per_m")} - lags
    if (lags | parts) & alike or misses or diagnosis.observations.away_from_bias:
        return []
    at = diagnosis.observations.covariates[["distance_m", "current_A"]].mean()
    d, i = np.asarray(at["distance_m"]), np.asarray(at["current_A"])
    inductance, (forms,) = base.magnetics.inductance(d, i), base.eddy.forms(d)
    drawn = float((forms.coupling[0] ** 2 / base.eddy.resistances_ohm).sum() * inductance)
    here = f"at {amount(float(d), 'm')} and {amount(float(i), 'A')}"
    if not named:
        return [
            f"The lag is what the drawing predicts: the field follows a slow current by {amount(drawn, 's')} {here}."
        ]
    more = sum(slow_lag(p) if name == EDDY_CURRENT_LAG.name else drawn * p["change"] for name, p in named.items())
    off = f"{amount(abs(more), 's')} {'more' if more > 0.0 else 'less'}"
    return [f"The field lags a slow current by {off} than the {amount(drawn, 's')} that the drawing predicts {here}."]


_SHOWN, _ALIKE, _CLASS = 8, 4, 6

_VERDICTS = {
    "nothing_missing": "Nothing is missing: the model explains these data within their noise{scatter}{own}.",
    "nothing_named": "No effect is named, but the model misses {left}.",
    "named": "Missing: {names}. With {it} the model explains these data within their noise{scatter}{own}.",
    "named_and_left": "Missing: {names}. With {it} the model still misses {left}.",
    "nothing_named_if_assumed": "Nothing is missing {assumed}",
    "named_and_left_if_assumed": "Missing: {names}. With {it} nothing else is missing {assumed}",
    "form_insufficient": "Missing: {names}, which {explain} {part} of the misfit, but not its exact form.",
    "unexplained": "Something is missing that no effect of the catalogue explains, nor several of them.",
    "dominant": "Something is missing that no effect of the catalogue explains in all. Most of it is {names}, which "
    "explains {part} of the misfit, not all of it.",
    "compare_only": "No verdict. {why}",
}


def diagnosis_lines(diagnosis: "Diagnosis") -> list[str]:
    """The result as lines of text, the verdict first."""
    noise = diagnosis.campaign.noise if diagnosis.campaign else None
    unknown = not_judged(diagnosis.observations, noise)
    lines = [*suspicions(diagnosis.findings), verdict_sentence(diagnosis), *unknown]
    for one in (*diagnosis.missing, *([diagnosis.dominant] if diagnosis.dominant else [])):
        lines += _named(one)
    lines += lag_lines(diagnosis, misses=_misses(diagnosis))
    lines += [] if diagnosis.missing else _not_shown(diagnosis)
    lines += str(diagnosis.error_fall).split("\n") if diagnosis.missing else _misfit(diagnosis)
    if diagnosis.missing:
        lines.append(certainty_sentence(diagnosis))
    if diagnosis.where.channel:
        lines.append(f"Where: {diagnosis.where.sentence}")
    if (
        diagnosis.own_misfit
        and not diagnosis.observations.away_from_bias
        and granted_channels(diagnosis.observations, _left(diagnosis)[2])
    ):
        lines.append(finer_model(diagnosis.model))
    lines += _evidence(diagnosis)
    allowed, after = [allowed_for(diagnosis.observations, noise)], diagnosis.lack_of_fit_after
    if after and after.p_value > LEVEL_AFTER:
        allowed.append(also_allowed(diagnosis.observations, _left(diagnosis)[2]))
    allowed = [one for one in allowed if one and one not in "".join(lines)]
    if allowed:
        lines.append(f"The test allows for {' and for '.join(allowed)}.")
    skip = diagnosis.findings[-1] if diagnosis.verdict == "compare_only" else None
    return [*lines, *notes(tuple(f for f in diagnosis.findings if f is not skip)), *_could_show(diagnosis)]


def verdict_sentence(diagnosis: "Diagnosis") -> str:
    """The verdict in one sentence."""
    most = [diagnosis.dominant] if diagnosis.dominant else []
    named = (*diagnosis.missing, *most)
    joint = ", and " if any(len(one.tie) > 1 for one in named) else " and "
    names = joint.join(_any_of(one.tie, "one of ") for one in named)
    part = next((_part(one.explained_share) for one in named), "")
    it, explain = ("them", "explain") if len(diagnosis.missing) > 1 else ("it", "explains")
    rms, beyond, left = _left(diagnosis)
    if diagnosis.own_misfit:
        return own_misfit_sentence(diagnosis.observations, diagnosis.times_own, left)
    why = str(diagnosis.findings[-1]) if diagnosis.findings else ""
    after = diagnosis.lack_of_fit_after
    own = (
        " and its own misfit to the table that it was fitted to"
        if beyond or (after and after.p_value <= LEVEL_AFTER)
        else ""
    )
    also = {"nothing_missing": "nothing_named", "named": "named_and_left"}
    kind = also.get(diagnosis.verdict, diagnosis.verdict) if left else diagnosis.verdict
    kind = "dominant" if most else kind
    assumed = ""
    if diagnosis.campaign and kind in also.values():
        assumed = if_mounts_are_assumed(diagnosis.observations, diagnosis.campaign.noise, rms, left)
        kind = f"{kind}_if_assumed" if assumed else kind
    allowed = _scatter(diagnosis)
    sentence = _VERDICTS[kind].format(
        names=names,
        it=it,
        explain=explain,
        part=part,
        why=why,
        scatter=f" and {allowed}" if allowed else "",
        own=own,
        left=" and ".join(left.values()),
        assumed=assumed,
    )
    if diagnosis.missing and (clean := diagnosis.clean) and clean.name_too_often:
        sentence += (
            f" But noise alone was given a name in {clean.named} of {clean.campaigns} simulated clean campaigns."
        )
    return sentence


def _part(share: float) -> str:
    """The part of a misfit that something explains but does not explain in all."""
    return amount(min(max(share, 0.0), 0.999), "", 3 if share > 0.99 else 2)


def _left(diagnosis: "Diagnosis") -> tuple[dict[str, float], dict[str, float], dict[str, str]]:
    """Errors after, those beyond the noise, and in words those that the model's own misfit does not make."""
    rms = {one.channel: one.rms_after for one in diagnosis.error_fall.channels}
    beyond = beyond_noise(diagnosis.observations, diagnosis.campaign.noise, rms) if diagnosis.campaign else {}
    return rms, beyond, beyond_own_misfit(diagnosis.observations, beyond, rms)


def _misses(diagnosis: "Diagnosis") -> bool:
    """Whether something is left beside what is named."""
    return diagnosis.verdict not in {"nothing_missing", "named"} or bool(_left(diagnosis)[2])


def certainty_sentence(diagnosis: "Diagnosis") -> str:
    """How far what is named can be trusted against other causes."""
    if diagnosis.confident:
        if diagnosis.excluded:
            considered = "Not certain: no other effect of those considered would give these readings; excluded: "
            return f"{considered}{', '.join(diagnosis.excluded)}."
        if diagnosis.dimensions_suspected:
            return "Certain: no other effect of the catalogue and no number of the drawing would give these readings."
        unsuspected = dimensions_unsuspected(diagnosis)
        return f"Certain among the catalogue's effects: no other would give these readings. {unsuspected}"
    members = list(dict.fromkeys(n for one in diagnosis.missing for n in one.members[1:]))
    if members:
        return f"Not certain: {_any_of(members)} would give the same readings. femfit suggest says what to measure."
    if diagnosis.look_alikes:
        alike = _any_of(diagnosis.look_alikes[:_ALIKE])
        return f"Not certain: {alike}, or a cause like it that the catalogue lacks, could give these readings."
    return f"Not certain: {_why_uncertain(diagnosis)}."


def dimensions_unsuspected(diagnosis: "Diagnosis") -> str:
    """That the drawing's dimensions were not looked at, and what would change that; empty where they were."""
    if diagnosis.dimensions_suspected:
        return ""
    how = "" if diagnosis.observations.nominal.circuits else ": sweep with --signatures to have them there"
    return f"The drawing's dimensions were not among the suspects{how}."


def _why_uncertain(diagnosis: "Diagnosis") -> str:
    if diagnosis.campaign and "guess" in diagnosis.campaign.noise.source.values():
        return "the noise is a guess. Measure some settings twice, or declare it"
    if any(not fit.converged for fit in diagnosis.explanations[:1]):
        return "the fit was ended before it had settled, so its sizes are not final"
    if diagnosis.clean and diagnosis.clean.name_too_often:
        return "noise alone is often given a name with these readings"
    if diagnosis.verdict != "named":
        return "the readings differ from its exact form"
    if all(one.plausible for one in diagnosis.missing):
        return "other sets of effects are together as probable as just what is named"
    return "its size is unusual. Check it by another measurement"


def _any_of(names: Sequence[str], before: str = "") -> str:
    """``a, b or c``, the first :data:`_CLASS` of them; ``before`` stands before several."""
    shown, more = list(names[:_CLASS]), len(names) - _CLASS
    shown = [*shown, counted(more, "further one")] if more > 1 else list(names)
    return f"{before}{', '.join(shown[:-1])} or {shown[-1]}" if len(shown) > 1 else shown[0]


def _scatter(diagnosis: "Diagnosis") -> str:
    """What a passing model is granted beside the noise, where it misses by clearly more than that."""
    if not any((one.after_over_noise or 0.0) > WITHIN_NOISE for one in diagnosis.error_fall.channels):
        return ""
    return allowed_for(diagnosis.observations, diagnosis.campaign.noise if diagnosis.campaign else None)


def _named(one: "NamedEffect") -> list[str]:
    effect = known_effect(one.name)
    symptom = effect.symptom if effect else ""
    when = "" if one.runs is None else f", {_in_runs(*one.runs)}"
    lines = [f"  {one.name}{when}: {'; '.join(one.words)}." if one.words else f"  {one.name}{when}: {symptom}"]
    if not one.plausible:
        lines.append("  This size is unusual: check it by another measurement before trusting the name.")
    others = zip(one.tie[1:_CLASS], one.tied_words, strict=False)
    return lines + [f"  or {name}: {'; '.join(words)}." for name, words in others if words]


def _in_runs(first: int, last: int) -> str:
    return f"until run {last}" if first == 1 else f"from run {first} on"


def _misfit(diagnosis: "Diagnosis") -> list[str]:
    lines = []
    for one in diagnosis.error_fall.channels:
        size = one.amount(one.rms_before)
        noise = "" if one.noise is None else f", {one.before_over_noise:.3g} times the noise of one"
        lines.append(f"{CHANNEL_WORDS[one.channel]}: error {size} rms in {counted(one.readings, 'reading')}{noise}")
    return lines


def _not_shown(diagnosis: "Diagnosis") -> list[str]:
    """What may be missing all the same, since it changes no reading."""
    blind = [score.name for score in diagnosis.ranking if score.note == CHANGES_NOTHING]
    return [f"These readings cannot tell whether these are missing: {', '.join(blind)}."] if blind else []


def _evidence(diagnosis: "Diagnosis") -> list[str]:
    if diagnosis.verdict == "compare_only":
        return []
    lines = [f"Lack of fit: {probability(diagnosis.p_value)}" + _after(diagnosis) + "."]
    if diagnosis.verdict not in {"nothing_missing", "named"} or diagnosis.missing:
        ranked = [score for score in diagnosis.ranking if score.error_left >= 0.0][:_SHOWN]
        best = ", ".join(f"{score.name} {score.error_left:.3g}" for score in ranked)
        lines += [f"Error left with each effect alone, in times the noise of one reading: {best}."] if ranked else []
    if diagnosis.clean is not None:
        named = diagnosis.clean
        lines.append(
            f"False names: noise alone was given a name in {named.named} of {named.campaigns} simulated clean "
            f"campaigns; with 95 % confidence that happens in no more than {100.0 * named.bound:.2g} % of all such."
        )
    return lines


def _after(diagnosis: "Diagnosis") -> str:
    if diagnosis.lack_of_fit_after is None:
        return ""
    return f"; with what is named, {probability(diagnosis.lack_of_fit_after.p_value)}"


def _could_show(diagnosis: "Diagnosis") -> list[str]:
    """What the data could have shown, nine times in ten, and why they could not show the others."""
    if not diagnosis.detectable:
        return []
    nominal = diagnosis.observations.nominal
    effects = device_effects(nominal.circuits, nominal.drawn)
    shown = [
        (name, smallest_visible(effects[name], amplitudes, nominal))
        for name, amplitudes in diagnosis.detectable.items()
        if name not in {one.name for one in diagnosis.missing}
    ]
    beyond = " beyond the model's own misfit" if diagnosis.own_misfit else ""
    lines = [f"These data would have shown{beyond}, nine times in ten:"]
    lines += [f"  {name} from: {words}" for name, words in shown if words]
    why: dict[str, list[str]] = {}
    for score in diagnosis.ranking:
        if score.note:
            why.setdefault(score.note, []).append(score.name)
    return lines + [f"  not {', '.join(names)}: {note}" for note, names in why.items()]
