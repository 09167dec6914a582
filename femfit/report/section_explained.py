"""The diagnosis report's sections on what would explain the misfit, what else could, and what to measure next."""

from collections.abc import Iterable

import numpy as np
from markupsafe import Markup

from femfit.effects.catalogue import all_effects
from femfit.effects.effect import EffectParameter
from femfit.effects.words import smallest_visible
from femfit.identify.decision.diagnosis import NamedEffect
from femfit.identify.decision.diagnosis_text import certainty_sentence, verdict_sentence
from femfit.report.diagnosis_content import DiagnosisContent
from femfit.report.explained_figures import ranking_figure
from femfit.report.numbers import NOTHING, formula_markup, p_value, plain, significant
from femfit.report.section import Block, DataTable, Picture, Section, text
from femfit.report.style import svg_uri

SHOWN = 6
"""Suggestions in the table."""


def explained_section(content: DiagnosisContent) -> Section | None:
    """What the verdict names, how it ranks, and what the data could have shown.

    Returns
    -------
    Section or None
        None where nothing can be said for want of a noise floor.
    """
    diagnosis, decision = content.diagnosis, content.diagnosis.decision
    if decision is None:
        return None
    blocks: list[Block] = [_verdict(content)]
    named = [one.name for one in diagnosis.missing]
    members = [name for one in diagnosis.missing for name in one.members[1:]]
    testable = [score for score in diagnosis.ranking if not score.note]
    if diagnosis.verdict != "nothing_missing" and testable:
        blocks.append(
            Picture(
                "ranking-effects",
                svg_uri(ranking_figure(testable, decision.excess, named, members), "ranking-effects"),
                "Share of the structured misfit that each effect of the catalogue explains by itself.",
                Markup(
                    "How much of the misfit above the noise each effect explains by itself, re-mounts and run offsets "
                    "taken out. A similar effect also explains much: what decides is whether the misfit that "
                    "is left is noise."
                ),
            )
        )
    blocks += [_named_table(one, len(diagnosis.missing) > 1) for one in diagnosis.missing]
    return Section("explained", "What would explain it", tuple(blocks))


def _verdict(content: DiagnosisContent) -> Markup:
    """The sentences of the command, so that page and command cannot contradict each other."""
    diagnosis = content.diagnosis
    after = diagnosis.lack_of_fit_after
    sentences = [verdict_sentence(diagnosis)]
    if after is not None:
        sentences.append(f"With what is named the lack of fit has {p_value(after.p_value)}.")
    if diagnosis.missing:
        sentences.append(certainty_sentence(diagnosis))
    if diagnosis.clean is not None:
        sentences.append(f"Something is named in {diagnosis.clean}.")
    return text("{}", " ".join(sentences))


def _named_table(one: NamedEffect, together: bool) -> DataTable:
    effect = all_effects().get(one.name)
    units = {} if effect is None else {p.name: p for p in effect.parameters}
    rows = []
    for name, value in one.parameters.items():
        low, high = one.ci95.get(name, (np.nan, np.nan))
        p = units.get(name)
        rows.append(
            (
                p.description if p else name,
                significant(value, 4),
                f"{significant(low, 3)} … {significant(high, 3)}" if np.isfinite(low) else _no_interval(value, p),
                f"{plain(p.plausible[0])} … {plain(p.plausible[1])}" if p else NOTHING,
                formula_markup(p.unit) if p else "",
            )
        )
    doubt = "" if one.plausible else Markup(" <strong>Its size is unusual: check it by another measurement.</strong>")
    return DataTable(
        text(
            "{}. {} {} {} % of the misfit above the noise on runs left out.{}",
            one.name,
            f"{'; '.join(one.words)}." if one.words else effect.symptom if effect else "",
            "Together they explain" if together else "Explains",
            significant(100.0 * one.explained_share, 3),
            doubt,
        ),
        ("what it is", "fitted", "95 % interval", "usual", "unit"),
        tuple(rows),
    )


def _no_interval(value: float, parameter: EffectParameter | None) -> str:
    if parameter is None or parameter.nonlinear or value not in {parameter.lower, parameter.upper}:
        return NOTHING
    return "at its bound"


def alternatives_section(content: DiagnosisContent) -> Section | None:
    """The classes that the data do not split, effects they cannot show, and magnitudes they would have shown.

    Returns
    -------
    Section or None
        None for want of a noise floor.
    """
    diagnosis = content.diagnosis
    if content.diagnosis.decision is None:
        return None
    blocks: list[Block] = [
        text(
            "<strong>{} could as well be {}</strong>: on these data their misfits differ by less than chance makes "
            "them. The name is a class, not yet a cause.",
            one.name,
            " or ".join(one.members[1:]),
        )
        for one in diagnosis.missing
        if len(one.members) > 1
    ]
    if diagnosis.missing and not blocks:
        blocks.append(text("{}", certainty_sentence(diagnosis)))
    if not diagnosis.missing:
        blocks.append(
            Markup("An effect that is smaller than the magnitude below would not have shown, and may be there.")
        )
    blocks.append(_detectable(content))
    hidden = [(score.name, score.note) for score in diagnosis.ranking if score.note]
    if hidden:
        items = Markup("").join(text("<li>{}: {}</li>", name, note) for name, note in hidden)
        blocks.append(text("These data could not have shown:<ul>{}</ul>", items))
    return Section("alternatives", "What else could", tuple(blocks))


def _detectable(content: DiagnosisContent) -> DataTable:
    effects, nominal = all_effects(), content.diagnosis.observations.nominal
    rows = [
        (name, smallest_visible(effects[name], amplitudes, nominal) or NOTHING)
        for name, amplitudes in content.diagnosis.detectable.items()
        if name in effects
    ]
    return DataTable(
        Markup("Smallest size of each effect that these settings and this noise show nine times in ten"),
        ("effect", "size"),
        tuple(rows),
    )


def next_section(content: DiagnosisContent) -> Section | None:
    """The measurement that would decide."""
    diagnosis = content.diagnosis
    if diagnosis.verdict == "nothing_missing":
        return None
    blocks: list[Block] = []
    if diagnosis.verdict == "compare_only":
        blocks.append(
            Markup(
                "Measure some settings at least twice, the body taken off and put back between, or declare the "
                "noise of each channel in a .toml beside the data. Then the same command can name what is missing."
            )
        )
    elif diagnosis.verdict == "unexplained":
        blocks.append(
            text(
                "Look at the bench where the map is coloured. {} If the cause is physics that the catalogue lacks, an "
                "effect is one small file.",
                _nearest(content),
            )
        )
    elif content.suggestions:
        blocks += [
            Markup("What would split the class, the cheapest for what it splits first:"),
            _suggestions(content),
        ]
    elif content.recorded_motion and diagnosis.missing:
        names = dict.fromkeys(name for one in diagnosis.missing for name in one.members)
        blocks.append(text("What isolates each of them:{}", _isolating(names)))
    elif any(len(one.members) > 1 for one in diagnosis.missing):
        blocks.append(Markup("No measurement that femfit knows would split this class at the sizes found here."))
    else:
        names = dict.fromkeys(one.name for one in diagnosis.missing)
        blocks.append(text("These data decide by themselves. An independent check:{}", _isolating(names)))
    return Section("next", "What to measure next", tuple(blocks))


def _isolating(names: Iterable[str]) -> Markup:
    """The experiment that isolates each effect."""
    effects = all_effects()
    items = (text("<li><strong>{}</strong>: {}</li>", name, effects[name].experiment) for name in names)
    return text("<ul>{}</ul>", Markup("").join(items))


def _nearest(content: DiagnosisContent) -> Markup:
    found = content.diagnosis.decision
    if found is None or not found.candidates:
        return Markup("")
    best = found.candidates[0]
    share = 100.0 * (1.0 - best.excess / found.excess) if found.excess > 0.0 else 0.0
    return text(
        "The nearest of the catalogue, {}, takes away {} % of the misfit above the noise and leaves the rest.",
        " with ".join(best.fit.names),
        significant(float(np.clip(share, 0.0, 100.0)), 3),
    )


def _suggestions(content: DiagnosisContent) -> DataTable:
    rows = []
    for k, one in enumerate(list(content.suggestions)[:SHOWN], start=1):
        pairs = [(*_unlike(a, b), sigma) for a, b, sigma in one.separates]
        if len(pairs) > 1 and not one.remains:
            a, b, sigma = min(pairs, key=lambda pair: pair[2])
            said = text("all of them; the nearest, {} from {}, by {} σ", a, b, significant(sigma, 2))
        else:
            said = Markup("<br>").join(text("{} from {} by {} σ", a, b, significant(s, 2)) for a, b, s in pairs)
        if one.remains:
            left = "; ".join(" and ".join(_unlike(a, b)) for a, b in one.remains)
            said += text("<br>leaves together: {}", left)
        rows.append((str(k), one.text, f"{one.cost:.0f}", said))
    return DataTable(
        Markup("Cost is counted in readings of the usual sweep"),
        ("", "measurement", "cost", "separates"),
        tuple(rows),
    )


def _unlike(a: str, b: str) -> tuple[str, str]:
    """Two explanations without the effects that both have."""
    first, second = a.split(" + "), b.split(" + ")
    left = [name for name in first if name not in second], [name for name in second if name not in first]
    return " + ".join(left[0]) or a, " + ".join(left[1]) or b
