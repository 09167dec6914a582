"""The baselines beside femfit on campaigns of ``femfit trial --set``: what they name, and what a correction is worth.

For the error, what is wrong is found and fitted without the last run of a campaign, and the corrected model predicts
that run. Where the body was put back no model can know: a common shift of the run, as large as the mounts of this bench
scatter, is predicted from the run itself, for every method alike.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.errors import FemfitError
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.noise.whitening import NoiseModel, Whitening, chains_of
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.place import placed
from femfit.identify.refit.add_effects import add_effects
from femfit.identify.refit.unseen import beside_random
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import read_model
from femfit.tables.measurement import BenchTable
from femfit.tables.measurement_file import read_bench_table
from femfit.trial.counts import LEAST_LEVEL, Share
from femfit.trial.judge import COULD_BE_SHOWN, judge
from femfit.trial.virtual_bench import Meter
from support.trial_study.baselines import METHODS, installed, make_problem

AS_DRAWN, FEMFIT = "model as drawn", "femfit"

NOTHING, ONE, UNSEEN = "nothing", "one", "unseen"
"""Campaigns that hide nothing, one error of 1 sigma and more that could be shown, or such a cause without a name."""


@dataclass(frozen=True)
class Said:
    """What a method made of a campaign."""

    method: str
    hides: str  # NOTHING, ONE or UNSEEN
    something: bool  # Whether it says that the model lacks something
    right: bool  # Whether the truth is among its names
    names: int
    over_noise: float | None  # Error on the run left out; None where there is one run, or the error comes and goes


def compare_methods(directory: Path, progress: Callable[[int, int], None]) -> list[Said]:
    """Try femfit and all installed methods on the campaigns of a directory that femfit trial has written."""
    model, places = read_model(directory / "model.json"), sorted((directory / "campaigns").iterdir())
    result: list[Said] = []
    for done, place in enumerate(places):
        progress(done, len(places))
        key = json.loads((place / "hidden.json").read_text(encoding="utf-8"))
        result += _campaign(model, read_bench_table(place / "data.csv"), key)
    progress(len(places), len(places))
    return result


def _campaign(model: ActuatorModel, data: BenchTable, key: dict[str, Any]) -> list[Said]:
    """What every method makes of a campaign; nothing of one that is not counted."""
    found = _diagnosed(model, data) if _is_counted(key) else None
    if found is None:
        return []
    outcome = judge(0, key, found.to_dict())
    hides = NOTHING if not outcome.hidden else UNSEEN if any(outcome.unknown) else ONE
    observations = placed(model, data)
    last = observations.column("run") == observations.runs - 1
    judged = observations.runs > 1 and outcome.groups != ("when",)
    drawn = Said(AS_DRAWN, hides, False, False, 0, _error(observations, observations.base, key) if judged else None)
    names = sum(map(len, outcome.classes))
    named = bool(names) or outcome.verdict == "unexplained"
    after = _error_after_add(model, data, observations.runs, key) if judged else None
    said = [drawn, Said(FEMFIT, hides, named, bool(outcome.found) and all(outcome.found), names, after)]
    problem = make_problem(model, observations)
    if problem is None:  # without a noise no method has a scale
        return [*said, *(replace(drawn, method=name) for name in installed())]
    known = [{"name": name} for name in dict.fromkeys(problem.names)]
    for name, method in installed().items():
        answer, error = method(problem), drawn.over_noise
        if judged and answer.names:  # what all runs do not show, fewer do not
            correction = method(problem.only(~last)).correction * problem.sigma
            error = _error(observations, observations.base + correction, key)
        as_said = found.to_dict() | {"missing": [{"class": [one]} for one in answer.names], "ranking": known}
        right = judge(0, key, as_said).found
        said.append(Said(name, hides, bool(answer.names), bool(right) and all(right), len(answer.names), error))
    return said


def _diagnosed(model: ActuatorModel, data: BenchTable) -> Diagnosis | None:
    try:
        return diagnose(model, data, bootstrap=0)
    except FemfitError:
        return None


def _is_counted(key: dict[str, Any]) -> bool:
    """Whether a campaign hides nothing, or one error of 1 sigma and more that could be shown."""
    shown = list(key["shown"].values())
    return not shown or (len(shown) == 1 and key["level"] >= LEAST_LEVEL and shown[0] >= COULD_BE_SHOWN)


def _error_after_add(model: ActuatorModel, data: BenchTable, runs: int, key: dict[str, Any]) -> float | None:
    """That of the model after ``femfit add`` of what the other runs are said to lack."""
    rows = data.rows
    before = replace(data, rows=rows[pd.factorize(rows["run"])[0] < runs - 1].reset_index(drop=True))
    found = _diagnosed(model, before)
    try:
        if found and found.missing:
            model = add_effects(model, before, found).model
        elif found and found.verdict == "unexplained":
            model = add_effects(model, before, "unexplained").model
    except FemfitError:  # these readings are too few to add anything
        pass
    observations = placed(model, data)
    return _error(observations, observations.base, key)


def _error(observations: Observations, predicted: FloatArray, key: dict[str, Any]) -> float:
    """Root mean square over the true noise in the last run, over all channels, the run's shift predicted."""
    last = observations.column("run") == observations.runs - 1
    unseen, names = observations.select(last), observations.channels
    meters = [Meter(**key["meters"][name]) for name in names]
    sigma = np.array([np.hypot(one.sigma, one.step / np.sqrt(12.0)) for one in meters])
    none, many = np.zeros(len(names)), np.full(len(names), np.inf)
    noise = NoiseModel(names, sigma, none, key["mount_m"], none, many, many, {}, key["mount_m"], none)
    whitening = Whitening(unseen, noise, chains_of(unseen))
    left = beside_random((observations.value - predicted)[last], whitening) / sigma[unseen.channel]
    return float(np.sqrt(np.mean([np.mean(left[unseen.of(name)] ** 2) for name in names if unseen.of(name).any()])))


def comparison_lines(said: Sequence[Said]) -> list[str]:
    """The table, in Markdown, and the methods that are not installed.

    Names are counted in the mean of the campaigns with one error. Errors are over the noise, in the run left out: the
    median, nine campaigns of ten, and the number of campaigns.
    """
    here = [AS_DRAWN, FEMFIT, *installed()]
    head = ["", "nothing hidden: something found", "one error: something found", "truth among the names", "names"]
    head += [f"error, {what}" for what in ("nothing hidden", "one error", "cause without a name")]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for method in here:
        own = [one for one in said if one.method == method]
        nothing, one_error, unseen = ([one for one in own if one.hides == h] for h in (NOTHING, ONE, UNSEEN))
        named = [
            _share([one.something for one in nothing]),
            _share([one.something for one in one_error]),
            _share([one.right for one in one_error]),
            f"{np.mean([one.names for one in one_error]):.1f}" if one_error else "",
        ]
        cells = [method, *(named if method != AS_DRAWN else [""] * 4), *map(_errors, (nothing, one_error, unseen))]
        lines.append(f"| {' | '.join(cells)} |")
    missing = [f"{name} ({package})" for name, (package, _) in METHODS.items() if name not in here]
    return lines + [f"not installed, so not tried: {', '.join(missing)}"] * bool(missing)


def _share(hits: Sequence[bool]) -> str:
    share = Share(sum(hits), len(hits))
    low, high = share.ci95
    return f"{share.hits} of {share.of} ({100 * low:.0f} to {100 * high:.0f} %)"


def _errors(said: Sequence[Said]) -> str:
    errors = [one.over_noise for one in said if one.over_noise is not None]
    if not errors:
        return ""
    middle, most = np.quantile(errors, [0.5, 0.9])
    return f"{middle:.2f}, {most:.2f} ({len(errors)})"
