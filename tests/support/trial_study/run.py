"""The whole trial: make the cases, seal the keys, diagnose, open the keys, judge."""

import csv
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from femfit.core.atomic import replacing, write_json
from femfit.core.errors import DomainError, FemfitError
from femfit.core.processes import process_pool
from femfit.device.load import read_actuator
from femfit.device.parts import Actuator
from femfit.model.actuator_model import ActuatorModel
from support.trial_study.campaign.case import Case, Order, make_case
from support.trial_study.campaign.files import read_key, write_case, write_manifest
from support.trial_study.campaign.orders import draw_orders
from support.trial_study.engine import CaseFiles, diagnose_case, read_case, unseen_rms
from support.trial_study.judge import Judgement, judge
from support.trial_study.truth.bench_effects import possible_effects, twins_of
from support.trial_study.truth.families import Truth, load_truth

Progress = Callable[[int, int], None]
"""Takes how many cases are done, and of how many."""


@dataclass(frozen=True)
class CampaignKind:
    """What is measured in a case: static bench tables, unless a study brings another kind.

    Parameters
    ----------
    effects : callable
        The effects that an actuator can have and such a campaign can show.
    make : callable
        Takes the truth, the drawing's model and the order of a case; returns the case.
    families : tuple of str or None
        Field solutions that the truths use; all that the drawing admits where None.
    """

    effects: Callable[[Truth], list[str]] = possible_effects
    make: Callable[[Truth, ActuatorModel, Order], Case] = lambda truth, _model, order: make_case(truth, order)
    families: tuple[str, ...] | None = None


@dataclass(frozen=True)
class TrialOptions:
    """How a trial is made.

    Parameters
    ----------
    withhold : bool
        Whether single effects are diagnosed again with the effect out of the catalogue.
    further : callable, optional
        Further answers to a case, for methods to compare with: takes its files, returns lists of names by method.
    """

    cases: int = 60
    seed: int = 1
    workers: int = 2
    withhold: bool = True
    further: Callable[[CaseFiles], dict[str, list[str]]] | None = None
    kind: CampaignKind = CampaignKind()


def make_trial(
    drawings: Sequence[Path], directory: Path, options: TrialOptions, progress: Progress | None = None
) -> dict[int, str]:
    """Solve the drawings and their changed forms, measure the cases and seal their keys."""
    say = progress or (lambda _done, _total: None)
    kind, truths, models, files = options.kind, {}, {}, {}
    for drawing in drawings:
        actuator = read_actuator(drawing)
        truths[actuator.name] = load_truth(actuator, directory / "tables", kind.families, options.workers)
        files[actuator.name], models[actuator.name] = _drawing_model(actuator, directory / "tables", options.workers)
    possible = {name: kind.effects(truth) for name, truth in truths.items()}
    commitments = {}
    for order in draw_orders(possible, options.cases, options.seed):
        try:
            case = kind.make(truths[order.actuator], models[order.actuator], order)
        except DomainError:  # this actuator cannot show so much of it: one case fewer
            continue
        commitments[order.number] = write_case(case, files[order.actuator], directory)
        say(order.number, options.cases)
    write_manifest(directory, options.seed, commitments)
    return commitments


def _drawing_model(actuator: Actuator, tables: Path, workers: int) -> tuple[Path, ActuatorModel]:
    """The model of the drawing as it is, solved and fitted once."""
    from femfit.field.sweep import run_sweep
    from femfit.fit.build import fit_model
    from femfit.model.json_file import read_model, write_model

    path = tables / f"{actuator.name}.json"
    if not path.exists():
        sweep = run_sweep(actuator, tables / f"sweep-{actuator.name}", workers=workers)
        write_model(fit_model(sweep).model, path)
    return path, read_model(path)


def run_trial(
    directory: Path, commitments: Mapping[int, str], options: TrialOptions, progress: Progress | None = None
) -> list[Judgement]:
    """Diagnose and judge a trial's cases.

    Returns
    -------
    list of Judgement
        In the order of the cases; what was answered is written to ``answers/`` case by case.
    """
    say = progress or (lambda _done, _total: None)
    solve = partial(_one, directory, options)
    found: list[Judgement] = []
    if options.workers == 1:
        for item in commitments.items():
            found.append(solve(*item))
            say(len(found), len(commitments))
        return found
    with process_pool(options.workers) as pool:
        for future in as_completed([pool.submit(solve, *item) for item in commitments.items()]):
            found.append(future.result())
            say(len(found), len(commitments))
    return sorted(found, key=lambda judgement: judgement.case)


def _one(directory: Path, options: TrialOptions, number: int, commitment: str) -> Judgement:
    """Diagnose a case, open its key, try it without the effect, judge."""
    files = read_case(directory / "cases" / f"{number:04d}")
    answers: dict[str, Any] = {"full": diagnose_case(files)}
    if options.further is not None:
        answers["baselines"] = options.further(files)
    named = tuple(entry["name"] for entry in answers["full"]["missing"])
    try:
        answers["unseen_rms"] = unseen_rms(files, named)
    except FemfitError as error:
        answers["unseen_error"] = str(error)
    key = read_key(directory, number, commitment)  # from here on the truth is known; nothing above is changed
    hidden = key["order"]["effects"]
    if options.withhold and len(hidden) == 1 and key["order"]["level"] >= 1.0:
        answers["withheld"] = diagnose_case(files, tuple(hidden))
        twins = twins_of(hidden[0])
        answers["withheld_twins"] = diagnose_case(files, twins) if len(twins) > 1 else answers["withheld"]
    write_json(directory / "answers" / f"{number:04d}.json", answers)
    return judge(key, answers)


def write_cases_csv(judgements: Sequence[Judgement], path: Path) -> None:
    """Write one line a case."""
    rows = [_flat(judgement) for judgement in judgements]
    with replacing(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(name for row in rows for name in row)))
        writer.writeheader()
        writer.writerows(rows)


def _flat(judgement: Judgement) -> dict[str, Any]:
    data = judgement.to_dict()
    baselines = data.pop("baselines")
    flat = {name: _cell(value) for name, value in data.items()}
    return flat | {f"baseline_{name}": "|".join(found) for name, found in baselines.items()}


def _cell(value: Any) -> Any:
    if isinstance(value, tuple):
        return "|".join("/".join(item) if isinstance(item, tuple) else str(item) for item in value)
    return value
