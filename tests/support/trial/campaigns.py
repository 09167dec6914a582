"""Campaigns of a set: what each hides, what people do at a bench and leave out of its file, and how they are counted.

The bench, the diagnosis of the files and the judgement are those of ``femfit trial``.
"""

import json
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.errors import DomainError
from femfit.trial.campaigns import write_campaign
from femfit.trial.counts import Count, Outcome, Share, is_shown, right_names, says, trial_lines
from femfit.trial.virtual_bench import LEVELS, Campaign, make_campaign
from support.trial.sets import SETS
from support.trial.truth import GROUPS, PassingError

_TURN = (
    (), ("catalogue",), ("drawing",), ("catalogue",), (), ("when",), ("catalogue", "catalogue"), ("unseen",),
    ("catalogue",), (), ("drawing",), ("catalogue", "drawing"), ("catalogue",), (), ("when",), ("unseen",),
    ("catalogue",), ("drawing",), (), ("catalogue", "catalogue"),
)  # fmt: skip
"""What twenty campaigns of a set hide."""

EXTENTS = {"usual": 0.6, "three runs": 0.15, "one channel": 0.15, "few readings": 0.1}
ORDERS = {"kept": 0.6, "not written": 0.15, "shuffled": 0.125, "shuffled, not written": 0.125}
"""Parts of the campaigns."""

DECLARED = 0.5
"""Part of the campaigns whose noise stands beside the data."""


@dataclass(frozen=True, eq=False)
class SetCampaign:
    """What was measured of a set's truths, and with what habits."""

    number: int
    campaign: Campaign
    key: dict  # What the judgement of a set needs beside the key of a campaign
    declared_noise: dict  # Standard deviations that stand beside the data

    def write(self, directory):
        """Write the campaign's files."""
        write_campaign(self.campaign, directory, **self.key)
        declared = "".join(f"{channel} = {value:.4g}\n" for channel, value in self.declared_noise.items())
        (directory / "data.toml").unlink(missing_ok=True)
        if declared:
            (directory / "data.toml").write_text(declared, encoding="utf-8")
        return directory / "data.csv"


def measured_campaigns(device, cases, seed, truths):
    """Measure campaigns, where the device can show what each is to hide."""
    for number, (names, level) in enumerate(_orders(truths, cases, seed), 1):
        rng = np.random.default_rng([seed, number, 1 + SETS.index(truths.name)])
        extent, order = (str(list(parts)[int(rng.choice(4, p=list(parts.values())))]) for parts in (EXTENTS, ORDERS))
        declares = bool(rng.random() < DECLARED)
        errors = {name: truths.truths[name].build(device, rng) for name in names}
        try:
            campaign = make_campaign(device, errors, level, rng, extent)
        except DomainError:
            continue
        rows = campaign.rows
        if order.startswith("shuffled"):
            rows = rows.iloc[rng.permutation(len(rows))].reset_index(drop=True)
        if order.endswith("not written"):
            rows = rows.drop(columns="order")
        own = {name: [name.partition(" (")[0]] for name in errors}
        passing = {name: error for name, error in errors.items() if isinstance(error, PassingError)}
        key = {
            "set": truths.name,
            "when": {name: error.course(campaign.runs) for name, error in passing.items() if campaign.runs > 1},
            "habits": {"extent": extent, "order": order, "noise_declared": declares},
            "group": {name: truths.truths[name].group for name in errors},
            "right": {name: own[name] if e.names is None else list(e.names) for name, e in errors.items()},
        }
        declared = {name: meter.sigma for name, meter in campaign.meters.items() if declares}
        yield SetCampaign(number, replace(campaign, rows=rows), key, declared)


def _orders(truths, cases, seed):
    """What each campaign hides and at which level: going round each group's truths in random order."""
    rng = np.random.default_rng([seed, 1 + SETS.index(truths.name)])
    members = {}
    for name, truth in truths.truths.items():
        members.setdefault(truth.group, []).append(name)
    waiting = {group: [] for group in members}
    orders = []
    for number in range(cases):
        names = []
        for wanted in _TURN[number % len(_TURN)]:
            group = wanted if wanted in members else "catalogue"
            waiting[group] = waiting[group] or [str(name) for name in rng.permutation(members[group])]
            names.append(waiting[group].pop())
        orders.append((tuple(dict.fromkeys(names)), float(rng.choice(LEVELS)) if names else 0.0))
    return orders


@dataclass(frozen=True)
class SetOutcome:
    """The judgement of ``femfit trial`` of a campaign of a set, and what sets are judged for beside it."""

    outcome: Outcome
    groups: tuple  # Of each hidden error; without a name in the diagnosis it is unseen
    right_runs: bool | None  # Onset and end within one run; None where there is none, or the diagnosis says none


def judged(outcome, key, diagnosis):
    """What a set is judged for; ``unseen`` is also what a diagnosis without a drawing's signatures has no name for."""
    right, names = right_names(key), [suspect["name"] for suspect in diagnosis.get("ranking", ())]
    unseen = {name for name in key["hidden"] if names and not says(names, right[name])}
    groups = tuple("unseen" if name in unseen else key["group"][name] for name in key["hidden"])
    for name, (first, last) in key.get("when", {}).items():
        for cause in diagnosis["missing"]:
            if cause.get("when") and says(cause["class"], right[name]):
                begins, ends = cause["when"].get("first_run") or 1, cause["when"].get("last_run") or key["runs"]
                return SetOutcome(outcome, groups, abs(begins - first) <= 1 and abs(ends - last) <= 1)
    return SetOutcome(outcome, groups, None)


def read_judged(directory, outcomes):
    """The outcomes of a directory's campaigns with what stands in their files."""
    judgements = []
    for outcome in outcomes:
        files = (directory / "campaigns" / f"{outcome.number:04d}" / name for name in ("hidden.json", "diagnosis.json"))
        judgements.append(judged(outcome, *(json.loads(file.read_text(encoding="utf-8")) for file in files)))
    return judgements


def set_lines(judgements):
    """What ``femfit trial`` counts, of all campaigns but causes without a name, and of each group of single errors."""
    groups = {"all but a cause without a name": [each.outcome for each in judgements if each.groups != ("unseen",)]}
    for group in GROUPS:
        groups[group] = [each.outcome for each in judgements if each.groups == (group,)]
    lines = []
    for name, members in groups.items():
        lines += [f"-- {name}", *trial_lines(members)] if members else []
    noticed = [outcome.verdict in {"named", "unexplained"} for outcome in groups["unseen"] if is_shown(outcome)]
    runs = [each.right_runs for each in judgements if each.right_runs is not None and is_shown(each.outcome)]
    counted = {
        ("A cause without a name", "it was noticed"): noticed,
        ("An error that comes and goes", "its runs were right within one"): runs,
    }
    return lines + [str(Count(*what, Share(sum(hits), len(hits)))) for what, hits in counted.items() if hits]
