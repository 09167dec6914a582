"""What a trial counted: how often the diagnosis would be right on a device."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from femfit.trial.intervals import Share
from femfit.trial.judge import Judgement

SHOWN = 1.0
"""Smallest size, in standard deviations of a reading, of the hidden effects that are counted together."""


@dataclass(frozen=True)
class Count:
    """How many cases of a group had an outcome."""

    group: str
    outcome: str
    share: Share

    def __str__(self) -> str:
        low, high = self.share.ci95
        percent = f" ({100 * self.share.value:.0f} %, 95 % between {100 * low:.0f} and {100 * high:.0f} %)"
        return f"{self.group}: {self.outcome} in {self.share.hits} of {self.share.of}{percent if self.share.of else ''}"


def counts(judgements: Sequence[Judgement]) -> list[Count]:
    """Count a trial; groups without any case are left out."""
    single = [j for j in judgements if len(j.effects) == 1 and j.level >= SHOWN]
    groups: list[tuple[str, list[Judgement], list[tuple[str, Callable[[Judgement], bool]]]]] = [
        (
            "Nothing hidden",
            [j for j in judgements if not j.effects],
            [("an effect was named", lambda j: bool(j.named))],
        ),
        (
            "One effect hidden",
            single,
            [
                ("it stood among the names", lambda j: j.in_class[0]),
                ("it was named first", lambda j: j.first),
                ("it was named and called certain", lambda j: j.in_class[0] and j.confident),
                ("a wrong name was called certain", lambda j: j.confident and not j.in_class[0]),
                ("the right channel was pointed at", lambda j: bool(j.right_channel)),
            ],
        ),
        (
            "Two effects hidden",
            [j for j in judgements if len(j.effects) == 2 and j.level >= SHOWN],
            [
                ("both stood among the names", lambda j: all(j.in_class)),
                ("a third was named beside them", lambda j: j.spurious > 0),
            ],
        ),
        (
            "A cause that femfit does not know",
            [j for j in single if j.withheld_verdict],
            [
                ("a wrong name was called certain", lambda j: j.withheld_confident),
                ("a wrong name was given, not certain", lambda j: bool(j.withheld_named) and not j.withheld_confident),
            ],
        ),
        (
            "One small effect hidden",
            [j for j in judgements if len(j.effects) == 1 and j.level < SHOWN],
            [("it stood among the names", lambda j: j.in_class[0])],
        ),
    ]
    return [
        Count(group, outcome, Share(sum(map(hit, cases)), len(cases)))
        for group, cases, outcomes in groups
        if cases
        for outcome, hit in outcomes
    ]


def by_effect(judgements: Sequence[Judgement]) -> Mapping[str, Mapping[str, Share]]:
    """Truth in the class, named first, and misnamed when withheld, by hidden effect of 1 sigma or more."""
    cases = [j for j in judgements if len(j.effects) == 1 and j.level >= SHOWN]
    result = {}
    for name in sorted({j.effects[0] for j in cases}):
        own = [j for j in cases if j.effects[0] == name]
        result[name] = {
            "in_class": Share(sum(j.in_class[0] for j in own), len(own)),
            "first": Share(sum(j.first for j in own), len(own)),
            "misnamed": Share(sum(j.withheld_twins_verdict == "named" for j in own), len(own)),
        }
    return result


def unseen_over_noise(judgements: Sequence[Judgement]) -> float | None:
    """Median error on runs that were not fitted, over that of a perfect model, where an effect was named and added."""
    values = [j.unseen_over_floor for j in judgements if j.unseen_over_floor is not None and j.effects and j.named]
    return median(values) if values else None


def trial_data(judgements: Sequence[Judgement]) -> dict[str, Any]:
    """A trial as JSON-ready data."""
    return {
        "counts": [
            {
                "group": count.group,
                "outcome": count.outcome,
                "hits": count.share.hits,
                "of": count.share.of,
                "ci95": list(count.share.ci95),
            }
            for count in counts(judgements)
        ],
        "unseen_over_noise": unseen_over_noise(judgements),
        "by_effect": {
            name: {what: [share.hits, share.of] for what, share in shares.items()}
            for name, shares in by_effect(judgements).items()
        },
        "cases": [judgement.to_dict() for judgement in judgements],
    }


def trial_lines(judgements: Sequence[Judgement]) -> list[str]:
    """What the command prints."""
    lines = [str(count) for count in counts(judgements)]
    error = unseen_over_noise(judgements)
    if error is not None:
        lines.append(f"Error on runs left out, the named effect added: {error:.2f} times that of a perfect model")
    lines.append("Which effects: named / hidden, of 1 standard deviation of a reading or more")
    return lines + [
        f"  {name:<32}{shares['in_class'].hits}/{shares['in_class'].of}"
        for name, shares in by_effect(judgements).items()
    ]
