"""What was said of a campaign beside what was hidden in it, and how often the diagnosis was right on a device."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from scipy import stats

COULD_BE_SHOWN = 24.0
"""Fall of the weighted sum of squares by the true error from which readings can show it."""


@dataclass(frozen=True)
class Outcome:
    """One campaign and what was said of it."""

    number: int
    hidden: tuple[str, ...]
    level: float
    could_be_shown: tuple[bool, ...]  # Per hidden error
    verdict: str
    classes: tuple[tuple[str, ...], ...]  # Each name with what it cannot be told from, itself first
    found: tuple[bool, ...]  # Per hidden error, whether some class has it
    named_first: bool  # Whether it is among those that the first name is as likely as
    certain: bool
    spurious: int  # Classes without any hidden error


def judge(number: int, key: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> Outcome:
    """Compare the diagnosis with what was hidden."""
    right, level, shown = right_names(key), key["level"], key.get("shown", {})
    every = [name for names in right.values() for name in names]
    classes = tuple(tuple(cause["class"]) for cause in diagnosis["missing"])
    unless_said = COULD_BE_SHOWN if level >= LEAST_LEVEL else 0.0
    return Outcome(
        number=number,
        hidden=tuple(right),
        level=level,
        could_be_shown=tuple(shown.get(name, unless_said) >= COULD_BE_SHOWN for name in right),
        verdict=diagnosis["verdict"],
        classes=classes,
        found=tuple(any(says(members, names) for members in classes) for names in right.values()),
        named_first=bool(classes) and says(diagnosis["missing"][0]["tie"], every),
        certain=bool(diagnosis["confident"]),
        spurious=sum(not says(members, every) for members in classes),
    )


def right_names(key: Mapping[str, Any]) -> dict[str, list[str]]:
    """By hidden error, the names of the diagnosis that say it."""
    return {name: key.get("right", {}).get(name, [name]) for name in key["hidden"]}


def says(names: Iterable[str], right: Iterable[str]) -> bool:
    """Whether one of the names is right; numbers of a material's curve count by the material."""
    wanted = {_subject(name) for name in right}
    return any(_subject(name) in wanted for name in names)


def _subject(name: str) -> str:
    return name.rpartition(".")[0] if name.startswith("materials.") else name


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
        interval = stats.binomtest(self.hits, self.of).proportion_ci(method="exact") if self.of else (0.0, 1.0)
        return float(interval[0]), float(interval[1])


@dataclass(frozen=True)
class Count:
    """How many campaigns of a group had an outcome."""

    data = "group", "outcome", "share", "ci95=share.ci95"

    group: str
    outcome: str
    share: Share

    def __str__(self) -> str:
        low, high = self.share.ci95
        percent = f" ({100 * self.share.value:.0f} %, 95 % between {100 * low:.0f} and {100 * high:.0f} %)"
        return f"{self.group}: {self.outcome} in {self.share.hits} of {self.share.of}{percent}"


def is_shown(outcome: Outcome) -> bool:
    """Whether something is hidden, and large enough for the readings to show it."""
    return bool(outcome.hidden) and outcome.level >= LEAST_LEVEL and all(outcome.could_be_shown)


def _groups(outcome: Outcome) -> Iterator[str]:
    """What a campaign is counted in."""
    if not outcome.hidden:
        yield "Nothing hidden"
    elif is_shown(outcome) and len(outcome.hidden) == 1:
        yield "One error hidden"
        if all(outcome.found) and all(len(names) == 1 for names in outcome.classes):
            yield "One error hidden, named alone in its class"
    elif is_shown(outcome):
        yield "Two errors hidden"
    yield "All campaigns"


_COUNTED: Mapping[str, Mapping[str, Callable[[Outcome], bool]]] = {
    "Nothing hidden": {
        "an effect was named": lambda outcome: bool(outcome.classes),
        '"nothing missing" was said': lambda outcome: outcome.verdict == "nothing_missing",
        "no verdict was given": lambda outcome: outcome.verdict in {"compare_only", "refused"},
    },
    "One error hidden": {
        "it stood among the names": lambda outcome: all(outcome.found),
        "it was named first, or as likely as the first": lambda outcome: outcome.named_first,
        "it was named and called certain": lambda outcome: all(outcome.found) and outcome.certain,
        "a wrong name was called certain": lambda outcome: outcome.certain and outcome.spurious > 0,
    },
    "One error hidden, named alone in its class": {"it was called certain": lambda outcome: outcome.certain},
    "Two errors hidden": {
        "both stood among the names": lambda outcome: all(outcome.found),
        "a third was named beside them": lambda outcome: outcome.spurious > 0,
    },
    "All campaigns": {
        "a wrong name was called certain": lambda outcome: outcome.certain and outcome.spurious > 0,
    },
}
"""What is counted of each group of campaigns, in the order of printing."""


def counts(outcomes: Sequence[Outcome]) -> list[Count]:
    """Count a trial; groups without any campaign are left out."""
    members = {group: [outcome for outcome in outcomes if group in _groups(outcome)] for group in _COUNTED}
    return [
        Count(group, name, Share(sum(map(hit, members[group])), len(members[group])))
        for group, hits in _COUNTED.items()
        for name, hit in hits.items()
        if members[group]
    ]


def by_error(outcomes: Sequence[Outcome]) -> dict[str, Share]:
    """How often each single hidden error that the readings can show stood among the names."""
    single = [(outcome.hidden[0], outcome.found[0]) for outcome in outcomes if "One error hidden" in _groups(outcome)]
    hits = {name: [hit for hidden, hit in single if hidden == name] for name in sorted(dict(single))}
    return {name: Share(sum(each), len(each)) for name, each in hits.items()}


def trial_data(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """What programs read of a trial."""
    return {
        "counts": counts(outcomes),
        "by_error": {name: [share.hits, share.of] for name, share in by_error(outcomes).items()},
        "cases": outcomes,
    }


def trial_lines(outcomes: Sequence[Outcome]) -> list[str]:
    """What the command prints."""
    return [
        *map(str, counts(outcomes)),
        "Which errors: named / hidden, of those that the readings can show",
        *(f"  {name:<44}{share.hits}/{share.of}" for name, share in by_error(outcomes).items()),
    ]
