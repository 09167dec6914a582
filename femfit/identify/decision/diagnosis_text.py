"""A diagnosis in plain sentences: the verdict, its size, how certain it is, where it shows, and what it rests on.

One of the sentences says whether a lag of the field is what the drawing predicts. Where the current i changes slowly,
eddy currents are e = -R^-1 C^T L di/dt. The field is that of i + C e, so that it follows late by C R^-1 C^T L. What
``eddy_current_lag`` finds adds its own shares times their time constants.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.text import amount, counted, probability
from femfit.effects.catalogue import device_effects, known_effect
from femfit.effects.lags import EDDY_CURRENT_LAG, slow_lag
from femfit.effects.words import smallest_visible
from femfit.identify.constants import LEVEL_AFTER, WITHIN_NOISE
from femfit.identify.decision.allowances import (
    allowed_for,
    also_allowed,
    beyond_noise,
    beyond_own_misfit,
    finer_model,
    granted_channels,
    if_mounts_are_assumed,
    not_judged,
    own_misfit_sentence,
)
from femfit.identify.readings.bench import notes, suspicions
from femfit.identify.signatures import CHANGES_NOTHING
from femfit.tables.measurement import CHANNEL_WORDS

if TYPE_CHECKING:
    from femfit.identify.decision.diagnosis import Diagnosis, NamedEffect


def lag_lines(diagnosis: "Diagnosis", *, misses: bool) -> list[str]:
    """The sentence, where the drawing has eddy currents, the data show them, and the model misses nothing else.

    The conductivity of one of several materials changes the lag, too, but the model's states do not say by how much.
    """
    base = diagnosis.model.without_effects
    lags = {EDDY_CURRENT_LAG.name, *(number.key for number in base.drawn if number.conducts)}
    named = {effect.name: effect.parameters for effect in diagnosis.missing if effect.name in lags}
    alike = {name for effect in diagnosis.missing for name in effect.members if effect.name not in lags}
    if base.eddy is None or len(base.circuits) != 1 or not (named or lags & diagnosis.detectable.keys()):
        return []
    parts = {number.key for number in base.drawn if number.key.endswith("conductivity_MS_per_m")} - lags
    if (lags | parts) & alike or misses or diagnosis.observations.away_from_bias:
        return []
    setting = diagnosis.observations.covariates[["distance_m", "current_A"]].mean()
    d, i = np.asarray(setting["distance_m"]), np.asarray(setting["current_A"])
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
    for effect in (*diagnosis.missing, *([diagnosis.dominant] if diagnosis.dominant else [])):
        lines += _named(effect)
    apart = _left(diagnosis)[2]
    lines += lag_lines(diagnosis, misses=bool(apart) or diagnosis.verdict not in {"nothing_missing", "named"})
    if diagnosis.missing:
        lines += [*str(diagnosis.error_fall).split("\n"), certainty_sentence(diagnosis)]
    else:  # what may be missing all the same, since it changes no reading
        blind = [score.name for score in diagnosis.ranking if score.note == CHANGES_NOTHING]
        lines += [f"These readings cannot tell whether these are missing: {', '.join(blind)}."] if blind else []
        for fall in diagnosis.error_fall.channels:
            error = f"{fall.amount(fall.rms_before)} rms in {counted(fall.readings, 'reading')}"
            noise_text = "" if fall.noise is None else f", {fall.before_over_noise:.3g} times the noise of one"
            lines.append(f"{CHANNEL_WORDS[fall.channel]}: error {error}{noise_text}")
    if diagnosis.where.channel:
        lines.append(f"Where: {diagnosis.where.sentence}")
    if (
        diagnosis.own_misfit
        and not diagnosis.observations.away_from_bias
        and granted_channels(diagnosis.observations, apart)
    ):
        lines.append(finer_model(diagnosis.model))
    lines += _evidence(diagnosis)
    allowed, after = [allowed_for(diagnosis.observations, noise)], diagnosis.lack_of_fit_after
    if after and after.p_value > LEVEL_AFTER:
        allowed.append(also_allowed(diagnosis.observations, apart))
    allowed = [text for text in allowed if text and text not in "".join(lines)]
    if allowed:
        lines.append(f"The test allows for {' and for '.join(allowed)}.")
    skip = diagnosis.findings[-1] if diagnosis.verdict == "compare_only" else None
    return [*lines, *notes(tuple(f for f in diagnosis.findings if f is not skip)), *_could_show(diagnosis)]


def verdict_sentence(diagnosis: "Diagnosis") -> str:
    """The verdict in one sentence."""
    most = [diagnosis.dominant] if diagnosis.dominant else []
    named = (*diagnosis.missing, *most)
    joint = ", and " if any(len(effect.tie) > 1 for effect in named) else " and "
    names = joint.join(_any_of(effect.tie, "one of ") for effect in named)
    share = min(max(named[0].explained_share, 0.0), 0.999) if named else 0.0  # of what is not explained in all
    portion = amount(share, "", 3 if share > 0.99 else 2)
    it, explain = ("them", "explain") if len(diagnosis.missing) > 1 else ("it", "explains")
    rms, beyond, missed = _left(diagnosis)
    if diagnosis.own_misfit:
        return own_misfit_sentence(diagnosis.observations, diagnosis.times_own, missed)
    why = str(diagnosis.findings[-1]) if diagnosis.findings else ""
    after = diagnosis.lack_of_fit_after
    of_its_own = (
        " and its own misfit to the table that it was fitted to"
        if beyond or (after and after.p_value <= LEVEL_AFTER)
        else ""
    )
    also = {"nothing_missing": "nothing_named", "named": "named_and_left"}
    kind = also.get(diagnosis.verdict, diagnosis.verdict) if missed else diagnosis.verdict
    kind = "dominant" if most else kind
    assumed = ""
    if diagnosis.campaign and kind in also.values():
        assumed = if_mounts_are_assumed(diagnosis.observations, diagnosis.campaign.noise, rms, missed)
        kind = f"{kind}_if_assumed" if assumed else kind
    allowed = ""
    if any((channel.after_over_noise or 0.0) > WITHIN_NOISE for channel in diagnosis.error_fall.channels):
        allowed = allowed_for(diagnosis.observations, diagnosis.campaign.noise if diagnosis.campaign else None)
    sentence = _VERDICTS[kind].format(
        names=names,
        it=it,
        explain=explain,
        part=portion,
        why=why,
        scatter=f" and {allowed}" if allowed else "",
        own=of_its_own,
        left=" and ".join(missed.values()),
        assumed=assumed,
    )
    if diagnosis.missing and (clean := diagnosis.clean) and clean.name_too_often:
        sentence += (
            f" But noise alone was given a name in {clean.named} of {clean.campaigns} simulated clean campaigns."
        )
    return sentence


def _left(diagnosis: "Diagnosis") -> tuple[dict[str, float], dict[str, float], dict[str, str]]:
    """Errors after, those beyond the noise, and in words those that the model's own misfit does not make."""
    rms = {channel.channel: channel.rms_after for channel in diagnosis.error_fall.channels}
    beyond = beyond_noise(diagnosis.observations, diagnosis.campaign.noise, rms) if diagnosis.campaign else {}
    return rms, beyond, beyond_own_misfit(diagnosis.observations, beyond, rms)


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
    members = list(dict.fromkeys(n for effect in diagnosis.missing for n in effect.members[1:]))
    if members:
        return f"Not certain: {_any_of(members)} would give the same readings. femfit suggest says what to measure."
    if diagnosis.look_alikes:
        alike = _any_of(diagnosis.look_alikes[:_ALIKE])
        return f"Not certain: {alike}, or a cause like it that the catalogue lacks, could give these readings."
    why = "its size is unusual. Check it by another measurement"
    if diagnosis.campaign and "guess" in diagnosis.campaign.noise.source.values():
        why = "the noise is a guess. Measure some settings twice, or declare it"
    elif any(not fit.converged for fit in diagnosis.explanations[:1]):
        why = "the fit was ended before it had settled, so its sizes are not final"
    elif diagnosis.clean and diagnosis.clean.name_too_often:
        why = "noise alone is often given a name with these readings"
    elif diagnosis.verdict != "named":
        why = "the readings differ from its exact form"
    elif all(effect.plausible for effect in diagnosis.missing):
        why = "other sets of effects are together as probable as just what is named"
    return f"Not certain: {why}."


def dimensions_unsuspected(diagnosis: "Diagnosis") -> str:
    """That the drawing's dimensions were not looked at, and what would change that; empty where they were."""
    if diagnosis.dimensions_suspected:
        return ""
    how = "" if diagnosis.observations.nominal.circuits else ": sweep with --signatures to have them there"
    return f"The drawing's dimensions were not among the suspects{how}."


def _any_of(names: Sequence[str], before: str = "") -> str:
    """``a, b or c``, the first :data:`_CLASS` of them; ``before`` stands before several."""
    shown, more = list(names[:_CLASS]), len(names) - _CLASS
    shown = [*shown, counted(more, "further one")] if more > 1 else list(names)
    return f"{before}{', '.join(shown[:-1])} or {shown[-1]}" if len(shown) > 1 else shown[0]


def _named(named: "NamedEffect") -> list[str]:
    effect, when = known_effect(named.name), ""
    if named.runs is not None:
        when = f", until run {named.runs[1]}" if named.runs[0] == 1 else f", from run {named.runs[0]} on"
    words = f"{'; '.join(named.words)}." if named.words else effect.symptom if effect else ""
    lines = [f"  {named.name}{when}: {words}"]
    if not named.plausible:
        lines.append("  This size is unusual: check it by another measurement before trusting the name.")
    tied = zip(named.tie[1:_CLASS], named.tied_words, strict=False)
    return lines + [f"  or {name}: {'; '.join(clauses)}." for name, clauses in tied if clauses]


def _evidence(diagnosis: "Diagnosis") -> list[str]:
    if diagnosis.verdict == "compare_only":
        return []
    after = diagnosis.lack_of_fit_after
    named = f"; with what is named, {probability(after.p_value)}" if after else ""
    lines = [f"Lack of fit: {probability(diagnosis.p_value)}{named}."]
    if diagnosis.verdict not in {"nothing_missing", "named"} or diagnosis.missing:
        ranked = [score for score in diagnosis.ranking if score.error_left >= 0.0][:_SHOWN]
        best = ", ".join(f"{score.name} {score.error_left:.3g}" for score in ranked)
        lines += [f"Error left with each effect alone, in times the noise of one reading: {best}."] if ranked else []
    if diagnosis.clean is not None:
        clean = diagnosis.clean
        lines.append(
            f"False names: noise alone was given a name in {clean.named} of {clean.campaigns} simulated clean "
            f"campaigns; with 95 % confidence that happens in no more than {100.0 * clean.bound:.2g} % of all such."
        )
    return lines


def _could_show(diagnosis: "Diagnosis") -> list[str]:
    """What the data could have shown, nine times in ten, and why they could not show the others."""
    if not diagnosis.detectable:
        return []
    nominal = diagnosis.observations.nominal
    effects = device_effects(nominal.circuits, nominal.drawn)
    shown = [
        (name, smallest_visible(effects[name], amplitudes, nominal))
        for name, amplitudes in diagnosis.detectable.items()
        if name not in {effect.name for effect in diagnosis.missing}
    ]
    beyond = " beyond the model's own misfit" if diagnosis.own_misfit else ""
    lines = [f"These data would have shown{beyond}, nine times in ten:"]
    lines += [f"  {name} from: {words}" for name, words in shown if words]
    why: dict[str, list[str]] = {}
    for score in diagnosis.ranking:
        if score.note:
            why.setdefault(score.note, []).append(score.name)
    return lines + [f"  not {', '.join(names)}: {note}" for note, names in why.items()]
