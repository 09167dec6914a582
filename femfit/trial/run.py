"""The trial's second half: diagnose the files of campaigns as the command does, and judge what was said.

``campaigns/0001/diagnosis.json`` then stands beside the data; what was hidden is read after the diagnosis.
"""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from functools import partial
from pathlib import Path
from typing import Any

from femfit.core.errors import FemfitError
from femfit.core.files import write_json
from femfit.core.processes import process_pool
from femfit.effects.catalogue import all_effects
from femfit.identify.decision.diagnose import diagnose
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import read_model
from femfit.trial.judge import Outcome, judge, right_names

Report = Callable[[int, int], None]
"""Takes how many campaigns are done, and of how many."""

_TWINS = {"force_offset": ("constant_force",), "constant_force": ("force_offset",)}
"""Effects that do the same to every channel of a bench as an error: left out of the catalogue together with it."""


def diagnose_campaigns(
    directory: Path, numbers: Sequence[int], *, workers: int, progress: Report | None = None
) -> list[Outcome]:
    """Diagnose and judge campaigns that were written, each from its files."""
    say = progress or (lambda _done, _total: None)
    solve = partial(_diagnose, directory)
    outcomes: list[Outcome] = []
    say(0, len(numbers))
    if workers == 1:
        for number in numbers:
            outcomes.append(solve(number))
            say(len(outcomes), len(numbers))
        return outcomes
    with process_pool(workers) as pool:
        for future in as_completed([pool.submit(solve, number) for number in numbers]):
            outcomes.append(future.result())
            say(len(outcomes), len(numbers))
    return sorted(outcomes, key=lambda outcome: outcome.number)


def _diagnose(directory: Path, number: int) -> Outcome:
    place = directory / "campaigns" / f"{number:04d}"
    model, data = read_model(directory / "model.json"), place / "data.csv"
    diagnosis = _diagnosis(model, data)
    write_json(place / "diagnosis.json", diagnosis)
    key = json.loads((place / "hidden.json").read_text(encoding="utf-8"))  # nothing above is changed from here on
    withheld = None
    right = [name for names in right_names(key).values() for name in names if name in all_effects()]
    if len(key["hidden"]) == 1 and right:
        twins = [twin for name in right for twin in _TWINS.get(name, ())]
        withheld = _diagnosis(model, data, (*right, *twins))
    return judge(number, key, diagnosis, withheld)


def _diagnosis(model: ActuatorModel, data: Path, exclude: Sequence[str] = ()) -> dict[str, Any]:
    """What the command says of a file; that it refuses it is an answer, too."""
    try:
        return diagnose(model, data, exclude=exclude, bootstrap=0).to_dict()
    except FemfitError as error:
        return {"verdict": "refused", "missing": [], "where": {"channel": ""}, "confident": False, "why": str(error)}
