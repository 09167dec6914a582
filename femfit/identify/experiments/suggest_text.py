"""Suggested measurements and what a plan can show, in plain sentences."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from femfit.effects.catalogue import all_effects
from femfit.effects.effect import Effect
from femfit.identify.experiments.plan import PlanReport
from femfit.identify.experiments.suggest import Suggestion
from femfit.identify.readings.amounts import magnitudes
from femfit.identify.refit.refit import Refit

_SHOWN = 8
_NOTHING = (
    "There is nothing to separate: no effect of the catalogue is missing, see femfit diagnose.",
    "There is nothing to separate: the data leave one explanation.",
)


def suggestion_lines(suggestions: Sequence[Suggestion], explanations: int) -> list[str]:
    """Suggested measurements as lines of text.

    Parameters
    ----------
    explanations : int
        How many explanations the data leave.

    Returns
    -------
    list of str
        A line a measurement with what it tells apart, and a line with what it leaves in doubt.
    """
    if explanations < 2:
        return [_NOTHING[explanations]]
    if not suggestions:
        return ["No measurement that femfit knows would separate these explanations."]
    lines = []
    for k, one in enumerate(suggestions[:_SHOWN], start=1):
        told = "; ".join(
            f"{name} from {_listed(others, 'and')}" for name, others in _gathered((a, b) for a, b, _ in one.separates)
        )
        sigma = min(s for _, _, s in one.separates)
        least = " at least" if len(one.separates) > 1 else ""
        lines.append(
            f"{k}. {one.text} It costs about {one.cost:.0f} readings and tells {told} ({sigma:.0f} sigma{least})."
        )
        if one.remains:
            left = "; ".join(_listed(group, "or") for group in _chained(one.remains))
            lines.append(f"   It would leave open: {left}.")
    return lines


def isolating_lines(explanations: Sequence[Refit]) -> list[str]:
    """What isolates each effect that a record of motion leaves, where no added readings can be tried."""
    names = list(dict.fromkeys(name for fit in explanations for name in fit.names))
    if len(explanations) < 2:
        return [_NOTHING[len(explanations)]]
    effects = all_effects()
    return ["What isolates each of them:", *(f"{name}: {effects[name].experiment}" for name in names)]


def _gathered(pairs: Iterable[tuple[str, str]]) -> list[tuple[str, list[str]]]:
    """Pairs as few (one, its partners), the one with most partners first."""
    left, result = list(pairs), []
    while left:
        name = Counter(name for pair in left for name in pair).most_common(1)[0][0]
        result.append((name, [a if b == name else b for a, b in left if name in {a, b}]))
        left = [pair for pair in left if name not in pair]
    return result


def _chained(pairs: Iterable[tuple[str, str]]) -> list[list[str]]:
    """Names that pairs connect, group by group."""
    groups: list[list[str]] = []
    for pair in pairs:
        met = [group for group in groups if set(group) & set(pair)]
        groups = [group for group in groups if group not in met]
        groups.append(list(dict.fromkeys([name for group in (*met, pair) for name in group])))
    return groups


def _listed(names: Sequence[str], word: str) -> str:
    return f" {word} ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def plan_lines(report: PlanReport) -> list[str]:
    """What a plan can show, as lines of text.

    Returns
    -------
    list of str
        Groups that stay together, with the direct readings that would tell, effects it cannot show, and the smallest
        magnitudes of the others.
    """
    lines = ["Assumed noise: " + ", ".join(f"{name} {sigma:.2g}" for name, sigma in report.noise.items())]
    effects = all_effects()
    if report.groups:
        lines.append("This plan could never tell apart, however large they usually get:")
        for group in report.groups:
            lines.append(f"  {', '.join(group)}")
            lines += [
                f"    {effects[name].calibrations[0].instruction}" for name in group if _calibrated(effects, name)
            ]
    else:
        lines.append("This plan could tell every visible effect from every other at its largest usual size.")
    more = [group for group in report.small_groups if group not in report.groups]
    if more:
        lines.append("Nor these where they are small, at three times the magnitudes below:")
        lines += [f"  {', '.join(group)}" for group in more]
    if report.invisible:
        lines.append("It could not show:")
        reasons = dict.fromkeys(report.invisible.values())
        lines += [f"  {', '.join(n for n, w in report.invisible.items() if w == why)}: {why}" for why in reasons]
    lines.append("Smallest magnitudes that it would show nine times in ten:")
    for name, amplitudes in report.detectable.items():
        lines.append(f"  {name}: {magnitudes(effects.get(name), amplitudes)}")
    return lines


def _calibrated(effects: Mapping[str, Effect], name: str) -> bool:
    return name in effects and bool(effects[name].calibrations)
