"""The whole trial: make the cases, seal the keys, diagnose, open the keys, judge."""

import csv
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from femfit.core.atomic import replacing, write_json
from femfit.core.errors import DomainError, FemfitError
from femfit.core.processes import process_pool
from femfit.device.load import read_actuator
from femfit.trial.campaign.case import make_case
from femfit.trial.campaign.files import read_key, write_case, write_manifest
from femfit.trial.campaign.orders import draw_orders
from femfit.trial.campaign.series_case import make_series_case, sizing_record
from femfit.trial.judge import Judgement, judge
from femfit.trial.truth.bench_effects import possible_effects, twins_of
from femfit.trial.truth.families import load_truth
from femfit.trial.truth.series_effects import SERIES_EFFECTS

Progress = Callable[[str], None]


@dataclass(frozen=True)
class TrialOptions:
    """A trial.

    Parameters
    ----------
    cases, seed : int
        How many, and of what random numbers.
    baselines : bool
        Whether the baselines run on the same files; they need scikit-learn.
    withhold : bool
        Whether single effects are diagnosed again with the effect out of the catalogue.
    families : tuple of str or None
        Field solutions that the truths may use; all where None.
    kind : {"bench", "series"}
        Static bench tables, or closed-loop records of a levitated body.
    """

    cases: int = 300
    seed: int = 1
    workers: int = 2
    baselines: bool = True
    withhold: bool = True
    families: tuple[str, ...] | None = None
    kind: Literal["bench", "series"] = "bench"


def make_trial(
    drawings: Sequence[Path], directory: Path, options: TrialOptions, progress: Progress | None = None
) -> dict[int, str]:
    """Make a trial's files.

    Parameters
    ----------
    directory : Path
        Of the trial; its ``tables`` keep field solutions and sweeps for the next.

    Returns
    -------
    dict of int to str
        Hash of every case's key, as in the manifest.
    """
    from femfit.field.sweep import run_sweep  # noqa: PLC0415  the solver loads only where tables are made
    from femfit.fit.build import fit_model  # noqa: PLC0415
    from femfit.model.json_file import read_model, write_model  # noqa: PLC0415

    say = progress or (lambda _: None)
    tables = directory / "tables"
    series = options.kind == "series"
    families = () if series else options.families
    truths, models = {}, {}
    for drawing in drawings:
        actuator = read_actuator(drawing)
        say(f"Solving {actuator.name}")
        truths[actuator.name] = load_truth(actuator, tables, families, options.workers)
        models[actuator.name] = tables / f"{actuator.name}.json"
        if not models[actuator.name].exists():
            sweep = run_sweep(actuator, tables / f"sweep-{actuator.name}", workers=options.workers)
            write_model(fit_model(sweep).model, models[actuator.name])
    possible = {name: list(SERIES_EFFECTS) if series else possible_effects(truth) for name, truth in truths.items()}
    loaded = {name: read_model(path) for name, path in models.items()}
    sized = {name: sizing_record(truths[name], loaded[name]) for name in truths} if series else {}
    commitments = {}
    for order in draw_orders(possible, options.cases, options.seed):
        say(f"Measuring {order.number} of {options.cases}")
        truth = truths[order.actuator]
        try:
            if series:
                case = make_series_case(truth, loaded[order.actuator], order, sized[order.actuator])
            else:
                case = make_case(truth, order)
        except DomainError as error:  # this actuator cannot show so much of it: one case fewer
            say(str(error))
            continue
        commitments[order.number] = write_case(case, models[order.actuator], directory)
    write_manifest(directory, options.seed, commitments)
    return commitments


def run_trial(
    directory: Path, commitments: Mapping[int, str], options: TrialOptions, progress: Progress | None = None
) -> list[Judgement]:
    """Diagnose and judge a trial's cases.

    Parameters
    ----------
    options : TrialOptions
        Processes, and what else to try.

    Returns
    -------
    list of Judgement
        In the order of the cases; also written to ``answers/`` case by case.
    """
    say = progress or (lambda _: None)
    solve = partial(_one, directory, options)
    found = []
    if options.workers == 1:
        for k, item in enumerate(commitments.items()):
            found.append(solve(*item))
            say(f"Diagnosed {k + 1} of {len(commitments)}")
        return found
    with process_pool(options.workers) as pool:
        futures = [pool.submit(solve, number, commitment) for number, commitment in commitments.items()]
        for k, future in enumerate(as_completed(futures)):
            found.append(future.result())
            say(f"Diagnosed {k + 1} of {len(commitments)}")
    return sorted(found, key=lambda j: j.case)


def _one(directory: Path, options: TrialOptions, number: int, commitment: str) -> Judgement:
    """Diagnose a case, open its key, try it without the effect, judge."""
    from femfit.trial.engine import diagnose_case, read_case, unseen_rms  # noqa: PLC0415

    files = read_case(directory / "cases" / f"{number:04d}")
    answers: dict[str, Any] = {"full": diagnose_case(files)}
    if options.baselines:
        from femfit.trial.baselines import baseline_names  # noqa: PLC0415  scikit-learn is an extra

        answers["baselines"] = baseline_names(files)
    named = tuple(one["name"] for one in answers["full"]["missing"])
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
        return "|".join("/".join(one) if isinstance(one, tuple) else str(one) for one in value)
    return value
