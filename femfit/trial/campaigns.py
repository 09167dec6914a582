"""Campaigns of a trial: solve the device and its changed forms, hide errors, measure, write.

::

    model.json                     what a diagnosis compares with
    campaigns/0001/data.csv        what was measured
    campaigns/0001/hidden.json     what was hidden
"""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FemfitError, MissingPartError
from femfit.core.files import write_json
from femfit.core.processes import process_pool
from femfit.core.results import json_ready
from femfit.core.text import counted
from femfit.device.load import read_actuator
from femfit.device.parts import Actuator
from femfit.device.rewrite import only, read_variants
from femfit.field.sweep import Progress, run_sweep
from femfit.fit.build import fit_model
from femfit.identify.decision.diagnose import diagnose
from femfit.model.json_file import read_model, write_model
from femfit.trial.counts import Outcome, judge
from femfit.trial.field_table import Device
from femfit.trial.hidden import HIDDEN_ERRORS, possible_errors, solve_device
from femfit.trial.virtual_bench import LEVELS, Campaign, make_campaign

ONE, TWO = 0.45, 0.25
"""Part of the campaigns with one and with two errors; the others hide nothing."""


def prepare_device(drawing: Path, directory: Path, *, workers: int, progress: Progress | None = None) -> Device:
    """Sweep a drawing and fit its model as a user would; and solve its changed forms for the virtual bench.

    The model has the numbers of the drawing as suspects, where it is one drawing and no sweep of variants.
    """
    actuator = read_actuator(drawing)
    if len(actuator.circuits) != 1 or len(actuator.coils) != 1:
        raise MissingPartError(
            "A trial needs a drawing of one coil, since its virtual bench varies one current and hides errors of its "
            f"winding; {actuator.name!r} has {counted(len(actuator.coils), 'coil')} in "
            f"{counted(len(actuator.circuits), 'circuit')}. Ask femfit diagnose on a bench table of yours instead."
        )
    suspects = read_variants(drawing) == only(actuator)
    swept = drawing if suspects else actuator
    table = run_sweep(swept, directory / "sweep", workers=workers, progress=progress, signatures=suspects)
    write_model(fit_model(table).model, directory / "model.json")
    return solve_device(actuator, directory / "forms", workers=workers, progress=progress)


def make_campaigns(device: Device, directory: Path, cases: int, seed: int) -> list[int]:
    """Measure and write campaigns.

    Returns
    -------
    list of int
        Numbers of those in which the device can show what they were to hide.
    """
    made = []
    for number, (names, level) in enumerate(_orders(device.actuator, cases, seed), 1):
        errors = {name: HIDDEN_ERRORS[name] for name in names}
        try:
            campaign = make_campaign(device, errors, level, np.random.default_rng([seed, number]))
        except DomainError:
            continue
        write_campaign(campaign, directory / "campaigns" / f"{number:04d}")
        made.append(number)
    return made


def _orders(actuator: Actuator, cases: int, seed: int) -> list[tuple[tuple[str, ...], float]]:
    """What each campaign hides, and at which level."""
    rng = np.random.default_rng(seed)
    possible = possible_errors(actuator)
    waiting: list[str] = []
    orders = []
    for number in range(1, cases + 1):
        share = (number * 7) % 20 / 20.0  # twenty campaigns hold the shares exactly
        count = 1 if share < ONE else 2 if share < ONE + TWO else 0
        waiting = waiting if len(waiting) >= count else [*waiting, *(str(name) for name in rng.permutation(possible))]
        errors, waiting = tuple(dict.fromkeys(waiting[:count])), waiting[count:]
        orders.append((errors, float(rng.choice(LEVELS)) if errors else 0.0))
    return orders


def write_campaign(campaign: Campaign, directory: Path, **more: Any) -> None:
    """Write a campaign's files into a directory, and what else may be said of what is hidden."""
    directory.mkdir(parents=True, exist_ok=True)
    campaign.rows.to_csv(directory / "data.csv", index=False, float_format="%.9g")
    write_json(directory / "hidden.json", json_ready(campaign) | more)


Report = Callable[[int, int], None]
"""Takes how many campaigns are done, and of how many."""


def diagnose_campaigns(
    directory: Path, numbers: Sequence[int], *, workers: int, progress: Report | None = None
) -> list[Outcome]:
    """Diagnose and judge campaigns that were written, each from its files."""
    say = progress or (lambda _done, _total: None)
    solve = partial(_diagnose, directory)
    outcomes: list[Outcome] = []
    say(0, len(numbers))
    with process_pool(workers) as pool:
        for future in as_completed([pool.submit(solve, number) for number in numbers]):
            outcomes.append(future.result())
            say(len(outcomes), len(numbers))
    return sorted(outcomes, key=lambda outcome: outcome.number)


def _diagnose(directory: Path, number: int) -> Outcome:
    place = directory / "campaigns" / f"{number:04d}"
    model, data = read_model(directory / "model.json"), place / "data.csv"
    try:
        diagnosis = diagnose(model, data).to_dict()
    except FemfitError as error:  # that the command refuses a file is an answer, too
        why = str(error)
        diagnosis = {"verdict": "refused", "missing": [], "where": {"channel": ""}, "confident": False, "why": why}
    write_json(place / "diagnosis.json", diagnosis)
    key = json.loads((place / "hidden.json").read_text(encoding="utf-8"))  # nothing above is changed from here on
    return judge(number, key, diagnosis)
