"""What a trial counted: how often the diagnosis would be right on a device."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from scipy import stats

from femfit.trial.run import Outcome

SHOWN = 1.0
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


def counts(outcomes: Sequence[Outcome]) -> list[Count]:
    """Count a trial; groups without any campaign are left out."""
    single = [one for one in outcomes if len(one.hidden) == 1 and one.level >= SHOWN]
    groups: list[tuple[str, list[Outcome], dict[str, Callable[[Outcome], bool]]]] = [
        (
            "Nothing hidden",
            [one for one in outcomes if not one.hidden],
            {"an effect was named": lambda one: bool(one.classes)},
        ),
        (
            "One error hidden",
            single,
            {
                "it stood among the names": lambda one: all(one.found),
                "it was named first": lambda one: one.named_first,
                "it was named and called certain": lambda one: all(one.found) and one.certain,
                "a wrong name was called certain": lambda one: one.certain and not all(one.found),
                "the right channel was pointed at": lambda one: one.right_channel,
            },
        ),
        (
            "Two errors hidden",
            [one for one in outcomes if len(one.hidden) == 2 and one.level >= SHOWN],
            {
                "both stood among the names": lambda one: all(one.found),
                "a third was named beside them": lambda one: one.spurious > 0,
            },
        ),
        (
            "The same campaigns again, the cause taken out of the catalogue",
            [one for one in single if one.withheld_certain is not None],
            {
                "a wrong name was called certain": lambda one: bool(one.withheld_certain),
                "a wrong name was given, not certain": lambda one: (
                    bool(one.withheld_named) and not one.withheld_certain
                ),
            },
        ),
        (
            "One small error hidden",
            [one for one in outcomes if len(one.hidden) == 1 and one.level < SHOWN],
            {"it stood among the names": lambda one: all(one.found)},
        ),
    ]
    return [
        Count(group, outcome, Share(sum(map(hit, cases)), len(cases)))
        for group, cases, hits in groups
        if cases
        for outcome, hit in hits.items()
    ]


def by_error(outcomes: Sequence[Outcome]) -> dict[str, Share]:
    """How often each single hidden error of 1 sigma or more stood among the names."""
    cases = [one for one in outcomes if len(one.hidden) == 1 and one.level >= SHOWN]
    names = sorted({one.hidden[0] for one in cases})
    own = {name: [one.found[0] for one in cases if one.hidden[0] == name] for name in names}
    return {name: Share(sum(found), len(found)) for name, found in own.items()}


def trial_data(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """A trial as JSON-ready data."""
    return {
        "counts": [asdict(count) | {"ci95": list(count.share.ci95)} for count in counts(outcomes)],
        "by_error": {name: [share.hits, share.of] for name, share in by_error(outcomes).items()},
        "cases": [asdict(one) for one in outcomes],
    }


def trial_lines(outcomes: Sequence[Outcome]) -> list[str]:
    """What the command prints."""
    return [
        *map(str, counts(outcomes)),
        "Which errors: named / hidden, of 1 standard deviation of a reading or more",
        *(f"  {name:<32}{share.hits}/{share.of}" for name, share in by_error(outcomes).items()),
    ]
