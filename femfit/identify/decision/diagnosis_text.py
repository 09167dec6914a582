"""A diagnosis in plain sentences."""

from femfit.effects.catalogue import all_effects
from femfit.identify.comparison.compare_text import SCATTERED
from femfit.identify.decision.diagnosis import Diagnosis, NamedEffect
from femfit.identify.readings.amounts import chance, magnitudes, times, unit_of
from femfit.identify.readings.notes import first_notes, last_notes

_SHOWN = 8
_ALIKE = 4
_SCATTER = " and the scatter of the distance from mount to mount, or from run to run"

_VERDICTS = {
    "nothing_missing": "Nothing is missing: the model explains these data within their noise{scatter}.",
    "named": "Missing: {names}. With {it} the misfit is within the noise{scatter}.",
    "form_insufficient": "Missing: {names}, which {explain} most of the misfit, but not its exact form.",
    "unexplained": "Something is missing, and it is no effect of the catalogue nor any two of them.",
    "compare_only": "These data can be compared, but nothing can be said to be missing.",
}


def diagnosis_lines(diagnosis: Diagnosis) -> list[str]:
    """The result as lines of text.

    Returns
    -------
    list of str
        What the data could have shown, the verdict, what it rests on, and what the data cannot tell apart.
    """
    lines = [*first_notes(diagnosis.findings), *_could_show(diagnosis), *_misfit(diagnosis)]
    names = " and ".join(one.name for one in diagnosis.missing)
    it, explain = ("them", "explain") if len(diagnosis.missing) > 1 else ("it", "explains")
    scatter = _SCATTER if _hidden_by_scatter(diagnosis) else ""
    lines.append(_VERDICTS[diagnosis.verdict].format(names=names, it=it, explain=explain, scatter=scatter))
    if diagnosis.where.channel:
        lines.append(f"Where: {diagnosis.where.sentence}")
    for one in diagnosis.missing:
        lines += _named(one, len(diagnosis.missing) > 1)
    if diagnosis.verdict == "named":
        lines.append(confidence_sentence(diagnosis))
    if diagnosis.verdict != "compare_only":
        lines += _evidence(diagnosis)
    return lines + last_notes(diagnosis.findings)


def _hidden_by_scatter(diagnosis: Diagnosis) -> bool:
    """Whether a channel still misses by clearly more than the noise of its readings."""
    rms = diagnosis.rms_after if diagnosis.missing else diagnosis.rms
    return any(rms[name] > SCATTERED * floor for name, floor in diagnosis.noise_floor.items() if name in rms)


def confidence_sentence(diagnosis: Diagnosis) -> str:
    """How far what is named can be trusted against causes that the catalogue does not hold."""
    name = "this name" if len(diagnosis.missing) == 1 else "these names"
    if diagnosis.confident:
        return f"Sure: no other effect of the catalogue, were it not listed, would have borne {name} on these data."
    if diagnosis.look_alikes:
        shown = diagnosis.look_alikes[:_ALIKE]
        listed = " or ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)
        return f"Not sure: on these data {name} would also be borne by a cause not listed that acts like {listed}."
    return f"Not sure: its size is unusual, as where a cause that is not listed bears {name}."


def _could_show(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.detectable:
        return []
    lines = ["These data could have shown (smallest magnitude, nine times in ten):"]
    effects = all_effects()
    for name, amplitudes in diagnosis.detectable.items():
        lines.append(f"  {name}: {magnitudes(effects.get(name), amplitudes)}")
    notes = [f"{score.name} ({score.note})" for score in diagnosis.ranking if score.note]
    return lines + ([f"  not: {'; '.join(notes)}"] if notes else [])


def _misfit(diagnosis: Diagnosis) -> list[str]:
    lines = []
    for name, rms in diagnosis.rms.items():
        floor = f", noise {diagnosis.noise_floor[name]:.3g}" if name in diagnosis.noise_floor else ""
        after = f", with what is named {diagnosis.rms_after[name]:.3g}" if diagnosis.missing else ""
        lines.append(f"{name}: rms misfit {rms:.3g}{after}{floor}")
    return lines


def _named(one: NamedEffect, together: bool) -> list[str]:
    effect = all_effects().get(one.name)
    lines = [f"{one.name}: {effect.symptom}" if effect else one.name]
    # Amplitudes that were not needed, and constants of shapes that are not there
    silent = (
        {p.name for p in effect.parameters if p.nonlinear or one.parameters.get(p.name) == p.null} if effect else set()
    )
    for name, value in one.parameters.items():
        if name not in one.ci95 and name in silent:
            continue
        interval = f" (95 %: {one.ci95[name][0]:.4g} to {one.ci95[name][1]:.4g})" if name in one.ci95 else ""
        lines.append(f"  {name} = {value:.4g}{unit_of(effect, name)}{interval}")
    who = "together they explain" if together else "explains"
    fall = f"{100 * one.error_fall:.0f} %"
    lines.append(f"  {who} {fall} of the structured misfit on runs left out; {chance(one.p_value)}")
    if len(one.members) > 1:
        lines.append(f"  these data cannot tell it from {', '.join(one.members[1:])}; femfit suggest says what would")
    if not one.sane:
        lines.append("  its size is unusual: check it by another measurement before trusting the name")
    return lines


def _evidence(diagnosis: Diagnosis) -> list[str]:
    lines = []
    for name, gate in (("before", diagnosis.gate_before), ("after", diagnosis.gate_after)):
        if gate is not None:
            lines.append(
                f"structure {name}: {times(gate.statistic)} times what noise gives, in {gate.degrees_of_freedom} "
                f"patterns, {chance(gate.p_value)}"
            )
    ranked = [score for score in diagnosis.ranking if not score.note][:_SHOWN]
    best = ", ".join(f"{score.name} ({score.chi2_fall:.0f})" for score in ranked)
    if diagnosis.verdict != "nothing_missing":
        lines.append(f"fall of the weighted sum of squares, each alone: {best}")
    if diagnosis.false_naming_rate is not None:
        lines.append(
            f"clean campaigns of this noise in which something is named: {100 * diagnosis.false_naming_rate:.1f} %"
        )
    return lines
