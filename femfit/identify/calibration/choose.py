"""Which numbers of a drawing are calibrated, and which effects are fitted beside them, after what a diagnosis names."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from femfit.device.drawn_numbers import NumberFacts
from femfit.effects.catalogue import effect_by_name
from femfit.identify.decision.naming import Decision

Runs = tuple[int, int] | None
"""First and last run in which an effect acts, counted from 1; None for all."""


@dataclass(frozen=True)
class Choice:
    """What is fitted."""

    numbers: tuple[NumberFacts, ...] = ()
    beside: Mapping[str, Runs] = field(default_factory=dict)  # Effects that are no numbers of the drawing
    # What was decided where the data leave it open, by the key path or the effect that it is about
    remarks: Mapping[str, str] = field(default_factory=dict)

    def without(self, effects: Iterable[str]) -> "Choice":
        """The same without some of the effects beside."""
        out = set(effects)
        beside = {name: runs for name, runs in self.beside.items() if name not in out}
        return Choice(self.numbers, beside, {k: text for k, text in self.remarks.items() if k not in out})


def with_named(choice: Choice, decision: Decision, known: Sequence[NumberFacts], *, asked: bool = False) -> Choice:
    """A choice with what a decision names besides.

    The numbers of a class are calibrated, each within its tolerance, though effects would give the same readings; where
    numbers were asked for, effects alone are fitted beside these. What changes between runs is no number of a drawing.
    """
    by_name = {one.name: one for one in known}
    fits = decision.chosen.fit.effects if decision.chosen and decision.chosen.fit else ()
    acts = {one.effect.name: (one.runs[0] + 1, one.runs[1] + 1) for one in fits if one.runs}
    numbers, beside, fitted = list(choice.numbers), dict(choice.beside), {one.key for one in choice.numbers}
    remarks = {k: text for k, text in choice.remarks.items() if k in fitted | beside.keys()}  # others are named anew
    for members in decision.classes:
        runs, drawn = acts.get(members[0]), _apart(by_name[name] for name in members if name in by_name)
        effects = [name for name in members if name not in by_name]
        if any(number in choice.numbers for number in drawn):
            continue
        if effects and (asked or runs or not drawn):
            name, others = effects[0], " or ".join(one for one in members if one != effects[0])
            beside[name] = runs
            if others:
                remarks[name] = f"{name} was fitted beside; {others} would give the same readings."
        elif asked:
            remarks[drawn[0].key] = f"{drawn[0].subject} is named as well; it was not asked for and stays as drawn."
        elif runs:
            remarks[drawn[0].key] = (
                f"{drawn[0].subject} has its other value from run {runs[0]} to run {runs[1]} alone, so that no one "
                "drawing is that of all runs. Calibrate with the runs of one state."
            )
        else:
            numbers = _apart([*numbers, *drawn])
            if len(members) > 1:
                remarks[drawn[0].key] = _left_open(drawn, effects)
    return Choice(tuple(numbers), beside, remarks)


def _apart(numbers: Iterable[NumberFacts]) -> list[NumberFacts]:
    """Those that move no place that an earlier one moves."""
    kept: list[NumberFacts] = []
    for number in numbers:
        if not any(map(number.overlaps, kept)):
            kept.append(number)
    return kept


def _left_open(drawn: Sequence[NumberFacts], effects: Sequence[str]) -> str:
    """What would explain the data as well, and a measurement that tells it apart."""
    keys = " or ".join(number.subject for number in drawn)
    said = f"{keys} was fitted, as the drawing's."
    if len(drawn) > 1:
        said = f"These data do not say which is wrong: {keys}. All of them were fitted, each within its tolerance."
    if not effects:
        return f"{said} Measure {drawn[0].subject} on the device itself."
    also = f"{' or '.join(effects)}, not in the drawing, would give the same readings."
    return f"{said} {also} To tell: {effect_by_name(effects[0]).check}"
