"""What a trial counted: how often the diagnosis would be right on a device."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from scipy import stats

from femfit.trial.judge import Outcome

Hit = Callable[[Outcome], bool]

LEAST_LEVEL = 1.0
"""Smallest size, in standard deviations of a reading, of the hidden errors that are counted together."""


@dataclass(frozen=True)
class Share:
    """A counted share."""

    hits: int
    of: int

    @property
    def value(self) -> float:
        """Hits over cases; NaN where there are none."""
        return self.hits / self.of if self.of else float("nan")

    @property
    def ci95(self) -> tuple[float, float]:
        """Exact 95 % limits (C. J. Clopper and E. S. Pearson, Biometrika 26 (1934) 404); 0 and 1 without cases."""
        low = float(stats.beta.ppf(0.025, self.hits, self.of - self.hits + 1)) if self.hits else 0.0
        high = float(stats.beta.ppf(0.975, self.hits + 1, self.of - self.hits)) if self.hits < self.of else 1.0
        return low, high


@dataclass(frozen=True)
class Count:
    """How many campaigns of a group had an outcome."""

    group: str
    outcome: str
    share: Share

    def __str__(self) -> str:
        low, high = self.share.ci95
        percent = f" ({100 * self.share.value:.0f} %, 95 % between {100 * low:.0f} and {100 * high:.0f} %)"
        return f"{self.group}: {self.outcome} in {self.share.hits} of {self.share.of}{percent}"


_HITS: Mapping[str, Mapping[str, Hit]] = {
    "Nothing hidden": {
        "an effect was named": lambda outcome: bool(outcome.classes),
        '"nothing missing" was said': lambda outcome: outcome.verdict == "nothing_missing",
        "no verdict was given": lambda outcome: outcome.verdict in {"compare_only", "refused"},
    },
    "One error hidden": {
        "it stood among the names": lambda outcome: all(outcome.found),
        "it was named first": lambda outcome: outcome.named_first,
        "it was named and called certain": lambda outcome: all(outcome.found) and outcome.certain,
        "a wrong name was called certain": lambda outcome: outcome.certain_and_wrong,
        "the right channel was pointed at": lambda outcome: outcome.right_channel,
    },
    "Two errors hidden": {
        "both stood among the names": lambda outcome: all(outcome.found),
        "a third was named beside them": lambda outcome: outcome.spurious > 0,
    },
    "The same campaigns again, the cause taken out of the catalogue": {
        "a wrong name was called certain": lambda outcome: bool(outcome.withheld_certain),
        "a wrong name was given, not certain": lambda outcome: (
            bool(outcome.withheld_named) and not outcome.withheld_certain
        ),
    },
    "One error hidden that the readings can hardly show": {
        "it stood among the names": lambda outcome: all(outcome.found),
        "a wrong name was called certain": lambda outcome: outcome.certain_and_wrong,
    },
    "All campaigns": {"a wrong name was called certain": lambda outcome: outcome.certain_and_wrong},
}
"""What is counted of each group of campaigns, in the order of printing."""


def counts(outcomes: Sequence[Outcome]) -> list[Count]:
    """Count a trial; groups without any campaign are left out."""
    single = [outcome for outcome in outcomes if len(outcome.hidden) == 1]
    visible = [outcome for outcome in single if is_shown(outcome)]
    groups = {
        "Nothing hidden": [outcome for outcome in outcomes if not outcome.hidden],
        "One error hidden": visible,
        "Two errors hidden": [outcome for outcome in outcomes if len(outcome.hidden) == 2 and is_shown(outcome)],
        "The same campaigns again, the cause taken out of the catalogue": [
            outcome for outcome in visible if outcome.withheld_certain is not None
        ],
        "One error hidden that the readings can hardly show": [outcome for outcome in single if not is_shown(outcome)],
        "All campaigns": list(outcomes),
    }
    return [
        Count(group, name, Share(sum(map(hit, groups[group])), len(groups[group])))
        for group, hits in _HITS.items()
        if groups[group]
        for name, hit in hits.items()
    ]


def is_shown(outcome: Outcome) -> bool:
    """Whether something is hidden, and large enough for the readings to show it."""
    return bool(outcome.hidden) and outcome.level >= LEAST_LEVEL and all(outcome.could_be_shown)


def by_error(outcomes: Sequence[Outcome]) -> dict[str, Share]:
    """How often each single hidden error that the readings can show stood among the names."""
    hits: dict[str, list[bool]] = {}
    for outcome in outcomes:
        if len(outcome.hidden) == 1 and is_shown(outcome):
            hits.setdefault(outcome.hidden[0], []).append(outcome.found[0])
    return {name: Share(sum(hits[name]), len(hits[name])) for name in sorted(hits)}


def trial_data(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """A trial as JSON-ready data."""
    return {
        "counts": [asdict(count) | {"ci95": list(count.share.ci95)} for count in counts(outcomes)],
        "by_error": {name: [share.hits, share.of] for name, share in by_error(outcomes).items()},
        "cases": [asdict(outcome) for outcome in outcomes],
    }


def trial_lines(outcomes: Sequence[Outcome]) -> list[str]:
    """What the command prints."""
    return [
        *map(str, counts(outcomes)),
        "Which errors: named / hidden, of those that the readings can show",
        *(f"  {name:<44}{share.hits}/{share.of}" for name, share in by_error(outcomes).items()),
    ]
