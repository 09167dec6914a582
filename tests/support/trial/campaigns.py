"""Campaigns of a set: what each hides, what people do at a bench and leave out of its file, and how they are counted.

The bench, the diagnosis of the files and the judgement are those of ``femfit trial``.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import pandas as pd

from femfit.core.errors import DomainError
from femfit.core.files import write_json
from femfit.trial.campaigns import write_campaign
from femfit.trial.counts import Count, Outcome, Share, is_shown, right_names, says, trial_lines
from femfit.trial.field_table import Device, HiddenError
from femfit.trial.virtual_bench import LEVELS, Campaign, Extent, make_campaign
from support.trial.sets import SETS, TruthSet
from support.trial.truth import Group, PassingError

_TURN: tuple[tuple[Group, ...], ...] = (
    (), ("catalogue",), ("drawing",), ("catalogue",), (), ("when",), ("catalogue", "catalogue"), ("unseen",),
    ("catalogue",), (), ("drawing",), ("catalogue", "drawing"), ("catalogue",), (), ("when",), ("unseen",),
    ("catalogue",), ("drawing",), (), ("catalogue", "catalogue"),
)  # fmt: skip
"""What twenty campaigns of a set hide."""

Order = Literal["kept", "not written", "shuffled", "shuffled, not written"]

EXTENTS: Mapping[Extent, float] = {"usual": 0.6, "three runs": 0.15, "one channel": 0.15, "few readings": 0.1}
ORDERS: Mapping[Order, float] = {"kept": 0.6, "not written": 0.15, "shuffled": 0.125, "shuffled, not written": 0.125}
"""Parts of the campaigns."""

DECLARED = 0.5
"""Part of the campaigns whose noise stands beside the data."""


@dataclass(frozen=True)
class Habits:
    """How a campaign is measured and written down."""

    extent: Extent = "usual"
    order: Order = "kept"
    noise_declared: bool = False


def drawn_habits(rng: np.random.Generator) -> Habits:
    """Habits at random."""
    extent = list(EXTENTS)[int(rng.choice(len(EXTENTS), p=list(EXTENTS.values())))]
    order = list(ORDERS)[int(rng.choice(len(ORDERS), p=list(ORDERS.values())))]
    return Habits(extent, order, bool(rng.random() < DECLARED))


def written(rows: pd.DataFrame, habits: Habits, rng: np.random.Generator) -> pd.DataFrame:
    """The rows as their file has them: shuffled, and without a column of their order, where that is the habit."""
    if habits.order.startswith("shuffled"):
        rows = rows.iloc[rng.permutation(len(rows))].reset_index(drop=True)
    return rows.drop(columns="order") if habits.order.endswith("not written") else rows


@dataclass(frozen=True, eq=False)
class SetCampaign:
    """What was measured of a set's truths, with what habits."""

    number: int
    campaign: Campaign
    errors: Mapping[str, HiddenError]
    truths: TruthSet
    habits: Habits

    @property
    def when(self) -> dict[str, tuple[int, int]]:
        """First and last run, from 1, of each error that does not act in all of them."""
        runs = self.campaign.runs
        passing = {name: error for name, error in self.errors.items() if isinstance(error, PassingError)}
        return {name: error.course(runs) for name, error in passing.items() if runs > 1}

    @property
    def right(self) -> dict[str, tuple[str, ...]]:
        """By hidden error, the names of the diagnosis that say it."""
        return {
            name: (name.partition(" (")[0],) if error.names is None else error.names
            for name, error in self.errors.items()
        }

    @property
    def declared_noise(self) -> dict[str, float]:
        """Standard deviations that stand beside the data; empty where they are left out."""
        meters = self.campaign.meters if self.habits.noise_declared else {}
        return {name: meter.sigma for name, meter in meters.items()}

    def write(self, directory: Path) -> Path:
        """Write the campaign's files, and with its key what the judgement of a set needs."""
        right = self.right
        write_campaign(
            self.campaign, directory, {name: replace(error, names=right[name]) for name, error in self.errors.items()}
        )
        write_noise(directory / "data.toml", self.declared_noise)
        key = json.loads((directory / "hidden.json").read_text(encoding="utf-8"))
        more = {
            "set": self.truths.name,
            "when": self.when,
            "habits": asdict(self.habits),
            "group": {name: self.truths.truths[name].group for name in self.errors},
        }
        write_json(directory / "hidden.json", key | more)
        return directory / "data.csv"


def write_noise(path: Path, sigma: Mapping[str, float]) -> None:
    """Declare the noise of channels beside their data; none where none is given."""
    path.unlink(missing_ok=True)
    if sigma:
        path.write_text("".join(f"{channel} = {value:.4g}\n" for channel, value in sigma.items()), encoding="utf-8")


def measured_campaigns(device: Device, cases: int, seed: int, truths: TruthSet) -> Iterator[SetCampaign]:
    """Measure campaigns, where the device can show what each is to hide."""
    for number, (names, level) in enumerate(_orders(truths, cases, seed), 1):
        rng = np.random.default_rng([seed, number, 1 + SETS.index(truths.name)])
        habits = drawn_habits(rng)
        errors = {name: truths.truths[name].build(device, rng) for name in names}
        try:
            campaign = make_campaign(device, errors, level, rng, habits.extent)
        except DomainError:
            continue
        campaign = replace(campaign, rows=written(campaign.rows, habits, rng))
        yield SetCampaign(number, campaign, errors, truths, habits)


def _orders(truths: TruthSet, cases: int, seed: int) -> list[tuple[tuple[str, ...], float]]:
    """What each campaign hides and at which level: going round each group's truths in random order."""
    rng = np.random.default_rng([seed, 1 + SETS.index(truths.name)])
    members: dict[Group, list[str]] = {}
    for name, truth in truths.truths.items():
        members.setdefault(truth.group, []).append(name)
    waiting: dict[Group, list[str]] = {group: [] for group in members}
    orders = []
    for number in range(cases):
        names: list[str] = []
        for wanted in _TURN[number % len(_TURN)]:
            group: Group = wanted if wanted in members else "catalogue"
            waiting[group] = waiting[group] or [str(name) for name in rng.permutation(members[group])]
            names.append(waiting[group].pop())
        orders.append((tuple(dict.fromkeys(names)), float(rng.choice(LEVELS)) if names else 0.0))
    return orders


@dataclass(frozen=True)
class SetOutcome:
    """The judgement of ``femfit trial`` of a campaign of a set, and what sets are judged for beside it."""

    outcome: Outcome
    groups: tuple[Group, ...]  # Of each hidden error; without a name in the diagnosis it is unseen
    right_runs: bool | None  # Onset and end within one run; None where there is none, or the diagnosis says none


def judged(outcome: Outcome, key: Mapping, diagnosis: Mapping) -> SetOutcome:
    """What a set is judged for; ``unseen`` is also what a diagnosis without a drawing's signatures has no name for."""
    right, names = right_names(key), [suspect["name"] for suspect in diagnosis.get("ranking", ())]
    unseen = {name for name in key["hidden"] if names and not says(names, right[name])}
    groups = tuple("unseen" if name in unseen else key["group"][name] for name in key["hidden"])
    return SetOutcome(outcome, groups, _right_runs(key, right, diagnosis))


def _right_runs(key: Mapping, right: Mapping[str, list[str]], diagnosis: Mapping) -> bool | None:
    for name, (first, last) in key.get("when", {}).items():
        for cause in diagnosis["missing"]:
            if cause.get("when") and says(cause["class"], right[name]):
                begins = cause["when"].get("first_run") or 1
                ends = cause["when"].get("last_run") or key["runs"]
                return abs(begins - first) <= 1 and abs(ends - last) <= 1
    return None


def read_judged(directory: Path, outcomes: Sequence[Outcome]) -> list[SetOutcome]:
    """The outcomes of a directory's campaigns with what stands in their files."""
    judgements = []
    for outcome in outcomes:
        files = (directory / "campaigns" / f"{outcome.number:04d}" / name for name in ("hidden.json", "diagnosis.json"))
        judgements.append(judged(outcome, *(json.loads(file.read_text(encoding="utf-8")) for file in files)))
    return judgements


def set_lines(judgements: Sequence[SetOutcome]) -> list[str]:
    """What ``femfit trial`` counts, of all campaigns but causes without a name, and of each group of single errors."""
    single = {
        group: [judgement.outcome for judgement in judgements if judgement.groups == (group,)]
        for group in get_args(Group)
    }
    named = [judgement.outcome for judgement in judgements if judgement.groups != ("unseen",)]
    lines = []
    for name, members in {"all but a cause without a name": named, **single}.items():
        lines += [f"-- {name}", *trial_lines(members)] if members else []
    noticed = [outcome.verdict in {"named", "unexplained"} for outcome in single["unseen"] if is_shown(outcome)]
    runs = [
        judgement.right_runs
        for judgement in judgements
        if judgement.right_runs is not None and is_shown(judgement.outcome)
    ]
    counted = {
        ("A cause without a name", "it was noticed"): noticed,
        ("An error that comes and goes", "its runs were right within one"): runs,
    }
    return lines + [str(Count(*what, Share(sum(hits), len(hits)))) for what, hits in counted.items() if hits]
