"""What a trial counted: how often the diagnosis would be right on a device."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from scipy import stats

from femfit.trial.judge import Outcome

Hit = Callable[[Outcome], bool]

LEAST_LEVEL = 1.0
"""Smallest size, in standard deviations of a reading, of the hidden errors that are counted together."""

_NAMED: Mapping[str, Hit] = {
    "it stood among the names": lambda one: all(one.found),
    "it was named first": lambda one: one.named_first,
    "it was named and called certain": lambda one: all(one.found) and one.certain,
    "a wrong name was called certain": lambda one: one.certain_and_wrong,
    "the right channel was pointed at": lambda one: one.right_channel,
}


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
    shown = [one for one in outcomes if _shown(one) and not any(one.unknown)]
    single = [one for one in shown if len(one.hidden) == 1]
    runs = [one for one in single if one.right_runs is not None]
    unknown = [one for one in outcomes if _shown(one) and any(one.unknown)]
    named_unknown: dict[str, Hit] = {
        "a name was given, not certain": lambda one: bool(one.classes) and not one.certain_and_wrong,
        "a wrong name was called certain": lambda one: one.certain_and_wrong,
    }
    groups: list[tuple[str, list[Outcome], Mapping[str, Hit]]] = [
        (
            "Nothing hidden",
            [one for one in outcomes if not one.hidden],
            {
                "an effect was named": lambda one: bool(one.classes),
                '"nothing missing" was said': lambda one: one.verdict == "nothing_missing",
                "no verdict was given": lambda one: one.verdict in {"compare_only", "refused"},
            },
        ),
        ("One error hidden", _of(single, "catalogue"), _NAMED),
        ("One number of the drawing is another", _of(single, "drawing"), _NAMED),
        ("One error that is away in some runs, or drifts", _of(single, "when"), _NAMED),
        (
            "One error of which it was said when it acts",
            runs,
            {"its runs were right within one": lambda one: bool(one.right_runs)},
        ),
        (
            "Two errors hidden",
            [one for one in shown if len(one.hidden) == 2],
            {
                "both stood among the names": lambda one: all(one.found),
                "a third was named beside them": lambda one: one.spurious > 0,
            },
        ),
        *(
            (f"A cause that the diagnosis has no name for, of {level:g} sigma", members, named_unknown)
            for level in sorted({one.level for one in unknown})
            for members in ([one for one in unknown if one.level == level],)
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
            "One error hidden that the readings can hardly show",
            [one for one in outcomes if len(one.hidden) == 1 and not _shown(one) and not any(one.unknown)],
            {
                "it stood among the names": lambda one: all(one.found),
                "a wrong name was called certain": lambda one: one.certain_and_wrong,
            },
        ),
        (
            "All campaigns",
            list(outcomes),
            {"a wrong name was called certain": lambda one: one.certain_and_wrong},
        ),
    ]
    return [
        Count(group, outcome, Share(sum(map(hit, cases)), len(cases)))
        for group, cases, hits in groups
        if cases
        for outcome, hit in hits.items()
    ]


def _shown(one: Outcome) -> bool:
    return bool(one.hidden) and one.level >= LEAST_LEVEL and all(one.could_be_shown)


def _of(outcomes: Sequence[Outcome], group: str) -> list[Outcome]:
    return [one for one in outcomes if group in one.groups]


def by_error(outcomes: Sequence[Outcome]) -> dict[str, Share]:
    """How often each single hidden error that the readings can show stood among the names."""
    cases = [one for one in outcomes if len(one.hidden) == 1 and _shown(one)]
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
        "Which errors: named / hidden, of those that the readings can show",
        *(f"  {name:<44}{share.hits}/{share.of}" for name, share in by_error(outcomes).items()),
    ]
