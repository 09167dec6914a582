"""The trial's table: what was asked for, what was reached, with exact intervals."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean, median
from typing import Any

from femfit.trial.counts import Share
from support.trial_study.judge import Judgement


@dataclass(frozen=True)
class Line:
    """One line of the table.

    Parameters
    ----------
    group, what : str
        Which cases, and what was counted.
    value : float
        Of a share, mean or median.
    limit : float or None
        What is asked for; None where nothing is.
    at_least : bool
        Whether the limit is a lower one.
    """

    group: str
    what: str
    share: Share | None
    value: float
    limit: float | None = None
    at_least: bool = True

    @property
    def met(self) -> bool | None:
        """Whether the value keeps the limit; None without a limit or without cases."""
        if self.limit is None or self.value != self.value:
            return None
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    def text(self) -> str:
        """As one line of plain text."""
        if self.share is None:
            figure = f"{self.value:6.2f}"
            asked = "" if self.limit is None else f"{'>=' if self.at_least else '<='} {self.limit:g}"
            return f"{self.group:<34}{self.what:<46}{figure:<26}{asked:<9}{_mark(self.met)}".rstrip()
        low, high = self.share.ci95
        figure = f"{100 * self.value:5.1f} % ({100 * low:.1f}..{100 * high:.1f}) of {self.share.of}"
        asked = "" if self.limit is None else f"{'>=' if self.at_least else '<='} {100 * self.limit:g} %"
        return f"{self.group:<34}{self.what:<46}{figure:<26} {asked:<9}{_mark(self.met)}".rstrip()

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        data = asdict(self) | {"met": self.met}
        return data | {"ci95": list(self.share.ci95)} if self.share else data


def _mark(met: bool | None) -> str:
    return "" if met is None else "met" if met else "MISSED"


def trial_table(judgements: Sequence[Judgement]) -> list[Line]:
    """Count a trial.

    Returns
    -------
    list of Line
        The issue's table, then what it does not ask for, then the baselines.
    """
    none = [j for j in judgements if not j.effects]
    one = [j for j in judgements if len(j.effects) == 1 and j.level >= 1.0]
    whole = [j for j in one if j.all_channels]
    two = [j for j in judgements if len(j.effects) == 2 and j.level >= 1.0]
    lines = [
        _share("no effect", "something named", none, lambda j: bool(j.named), 0.02, at_least=False),
        _share("no effect", "nothing missing", none, lambda j: j.verdict == "nothing_missing", 0.95),
    ]
    for group, cases, asked in (("one effect, all channels", whole, True), ("one effect, any channels", one, False)):
        found = [j for j in cases if j.in_class[0]]
        size = fmean(next(len(c) for c in j.classes if j.effects[0] in c) for j in found) if found else float("nan")
        lines += [
            _share(group, "truth in the class", cases, lambda j: j.in_class[0], 0.97 if asked else None),
            _share(group, "truth named first", cases, lambda j: j.first, 0.90 if asked else None),
            Line(group, "mean size of the class", None, size, 1.5 if asked else None, at_least=False),
            _share(group, "truth in the class, and called sure", cases, lambda j: j.in_class[0] and j.confident),
        ]
    lines += [
        _share("two effects", "both in classes", two, lambda j: all(j.in_class), 0.85),
        _share("two effects", "a spurious third", two, lambda j: j.spurious > 0, 0.05, at_least=False),
    ]
    lines += _withheld(judgements) + _where(judgements) + _unseen(judgements)
    weak = [j for j in judgements if len(j.effects) == 1 and j.level < 1.0]
    lines.append(_share("one effect of 0.5 sigma", "truth in the class", weak, lambda j: j.in_class[0]))
    return lines + _baselines(judgements)


def _share(
    group: str,
    what: str,
    cases: Sequence[Judgement],
    hit: Callable[[Judgement], bool],
    limit: float | None = None,
    *,
    at_least: bool = True,
) -> Line:
    share = Share(sum(map(hit, cases)), len(cases))
    return Line(group, what, share, share.value, limit, at_least)


def _withheld(judgements: Sequence[Judgement]) -> list[Line]:
    lines = []
    for level, limit in ((1.0, 0.15), (3.0, 0.05)):
        cases = [j for j in judgements if j.withheld_verdict and j.level == level]
        group = f"effect withheld, {level:g} sigma"
        lines += [
            _share(group, "misnamed, and called sure", cases, lambda j: j.withheld_confident, limit, at_least=False),
            _share(
                group,
                "the same, twins of the truth withheld too",
                cases,
                lambda j: j.withheld_twins_confident,
            ),
            _share(group, "misnamed at all", cases, lambda j: j.withheld_verdict == "named"),
            _share(group, "the same, twins of the truth withheld too", cases, _twins_misnamed),
            _share(
                group,
                "misnamed as what was not in the truth's class",
                cases,
                lambda j: _twins_misnamed(j) and not j.confounded,
            ),
        ]
    return lines


def _twins_misnamed(judgement: Judgement) -> bool:
    return judgement.withheld_twins_verdict == "named"


def _where(judgements: Sequence[Judgement]) -> list[Line]:
    cases = [j for j in judgements if len(j.effects) == 1 and j.level >= 1.0]
    group = "one effect, 1 and 3 sigma"
    return [
        _share(group, "right channel and covariate", cases, lambda j: bool(j.right_channel and j.right_covariate), 0.8),
        _share(group, "right channel", cases, lambda j: bool(j.right_channel)),
        _share(group, "right covariate", cases, lambda j: bool(j.right_covariate)),
    ]


def _unseen(judgements: Sequence[Judgement]) -> list[Line]:
    values = [j.unseen_over_floor for j in judgements if j.unseen_over_floor is not None and j.effects and j.named]
    middle = median(values) if values else float("nan")
    return [Line("after add, effect named", "median rms on unseen runs / floor", None, middle, 1.10, at_least=False)]


def _baselines(judgements: Sequence[Judgement]) -> list[Line]:
    lines = []
    for method in sorted(set().union(*(j.baselines for j in judgements))):
        cases = [j for j in judgements if method in j.baselines]
        none = [j.baselines[method] for j in cases if not j.effects]
        one = [(j.effects[0], j.baselines[method]) for j in cases if len(j.effects) == 1 and j.level >= 1.0]
        named, seen = Share(sum(map(bool, none)), len(none)), Share(sum(bool(found) for _, found in one), len(one))
        truth = Share(sum(name in found for name, found in one), len(one))
        count = fmean(len(found) for _, found in one) if one else float("nan")
        lines += [
            Line(method, "no effect: something found", named, named.value),
            Line(method, "one effect: something found", seen, seen.value),
            Line(method, "one effect: truth among the names", truth, truth.value),
            Line(method, "one effect: mean number of names", None, count),
        ]
    return lines


def by_effect(judgements: Sequence[Judgement]) -> dict[str, dict[str, Share]]:
    """Truth in the class, named first, and misnamed when withheld, by hidden effect of 1 sigma or more."""
    cases = [j for j in judgements if len(j.effects) == 1 and j.level >= 1.0]
    result = {}
    for name in sorted({j.effects[0] for j in cases}):
        own = [j for j in cases if j.effects[0] == name]
        result[name] = {
            "in_class": Share(sum(j.in_class[0] for j in own), len(own)),
            "first": Share(sum(j.first for j in own), len(own)),
            "misnamed": Share(sum(j.withheld_twins_verdict == "named" for j in own), len(own)),
        }
    return result
