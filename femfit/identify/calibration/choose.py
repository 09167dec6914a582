"""Which numbers of a drawing are calibrated, and which effects are fitted beside them, after what a diagnosis names."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from femfit.core.errors import TableError
from femfit.identify.calibration.redraw import Runs
from femfit.identify.calibration.suspects import Suspect
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.decision.diagnosis_text import verdict_sentence
from femfit.identify.decision.naming import Decision
from femfit.identify.experiments.suggest import suggest
from femfit.tables.measurement import Measurement


@dataclass(frozen=True)
class Choice:
    """What is fitted."""

    numbers: tuple[Suspect, ...] = ()
    beside: tuple[str, ...] = ()  # Effects that are no numbers of the drawing
    runs: Runs = field(default_factory=dict)
    remarks: tuple[str, ...] = ()  # What was decided where the data leave it open
    undecided: tuple[str, ...] = ()  # What was not, since the data do not tell a number from an effect

    def without(self, effects: Sequence[str]) -> "Choice":
        """The same without some of the effects beside."""
        return replace(
            self,
            beside=tuple(name for name in self.beside if name not in effects),
            remarks=tuple(text for text in self.remarks if text.partition(" ")[0] not in effects),
        )


@dataclass(frozen=True)
class Named:
    """What is missing, by a diagnosis or by a decision."""

    members: tuple[str, ...]  # Effects that would give the same readings, the most probable first
    runs: tuple[int, int] | None  # First and last run in which it acts, counted from 1; None for all


def with_named(
    choice: Choice, named: Sequence[Named], known: Sequence[Suspect], advice: Callable[[], str], *, asked: bool = False
) -> Choice:
    """A choice with what is missing besides.

    A class that holds numbers alone is calibrated as a whole, each number within its tolerance. One that holds effects
    as well decides nothing; nor does it where the numbers were asked for, beside which effects alone are fitted.
    """
    by_effect = {one.effect: one for one in known}
    numbers, beside, runs = list(choice.numbers), list(choice.beside), dict(choice.runs)
    remarks, undecided = list(choice.remarks), list[str]()
    for one in named:
        drawn = [by_effect[name] for name in one.members if name in by_effect]
        effects = [name for name in one.members if name not in by_effect]
        if any(number in choice.numbers for number in drawn) or one.members[0] in choice.beside:
            continue
        if effects and (asked or not drawn):
            beside.append(effects[0])
            if one.runs:
                runs[effects[0]] = one.runs
            if len(one.members) > 1:
                others = " or ".join(name for name in one.members if name != effects[0])
                remarks.append(f"{effects[0]} was fitted beside; {others} would give the same readings.")
        elif asked:
            remarks.append(f"{drawn[0].key} is named as well; it was not asked for and stays as drawn.")
        elif effects:
            undecided.append(f"{' or '.join(one.members)} would give the same readings.")
        elif one.runs:
            undecided.append(
                f"{drawn[0].key} has its other value from run {one.runs[0]} to run {one.runs[1]} alone, so that no one "
                "drawing is that of all runs. Calibrate with the runs of one state."
            )
        else:
            numbers += [number for number in drawn if number not in numbers]
            if len(drawn) > 1:
                keys = " or ".join(number.key for number in drawn)
                remarks.append(
                    f"These data do not say which is wrong: {keys}. All of them were fitted, each within its "
                    f"tolerance. {advice()}".rstrip()
                )
    return Choice(tuple(numbers), tuple(beside), runs, tuple(remarks), tuple(undecided))


def first_choice(found: Diagnosis, known: Sequence[Suspect], data: Measurement) -> Choice:
    """What the diagnosis of a drawing names.

    Raises
    ------
    TableError
        If that is nothing, or no number of the drawing, or the data do not tell a number from an effect.
    """
    named = [Named(one.members, one.runs) for one in found.missing]
    choice = with_named(Choice(), named, known, lambda: _advice(found, data))
    if choice.undecided:
        by_effect = {one.effect: one.key for one in known}
        keys = ",".join(by_effect[name] for one in named for name in one.members if name in by_effect)
        raise TableError(
            f"These data do not say what is wrong: {' '.join(choice.undecided)} {_advice(found, data)} Nothing is "
            "written. To blame a number all the same, ask for it; or for all of them, each within its tolerance: "
            f"--numbers '{keys}'"
        )
    if choice.beside and not choice.numbers:
        raise TableError(
            f"What is missing, {' and '.join(choice.beside)}, is no number of the drawing: nothing is calibrated or "
            "written. femfit add puts it into the model."
        )
    if not choice.numbers:
        raise TableError(
            "No number of the drawing is named, so there is nothing to calibrate, and nothing is written. "
            f"{verdict_sentence(found)} To fit numbers all the same, each within its tolerance, ask for them, or "
            "for all (--numbers)."
        )
    return choice


def next_choice(choice: Choice, decision: Decision, known: Sequence[Suspect], *, asked: bool) -> Choice:
    """A choice with what is missing beside it, too; what that leaves open is a remark."""
    fits = decision.chosen.fit.effects if decision.chosen and decision.chosen.fit else ()
    runs = {one.effect.name: one.runs for one in fits if one.runs}
    named = [
        Named(members, (first_last[0] + 1, first_last[1] + 1) if (first_last := runs.get(members[0])) else None)
        for members in decision.classes
    ]
    further = with_named(choice, named, known, lambda: "", asked=asked)
    left = tuple(f"Not fitted, since these data do not say what it is: {text}" for text in further.undecided)
    return replace(further, remarks=(*further.remarks, *left), undecided=())


def _advice(found: Diagnosis, data: Measurement) -> str:
    """What would tell the explanations apart."""
    advice = suggest(found.model, data, found)
    if advice.suggestions:
        return f"To tell them apart: {advice.suggestions[0].text}"
    return advice.isolating[0][1] if advice.isolating else "No measurement that femfit knows tells them apart."
