"""The trial: solve the device, measure campaigns with hidden errors, diagnose their files as the command does, judge.

::

    model.json                     what the diagnosis compares with
    campaigns/0001/data.csv        what was measured
    campaigns/0001/hidden.json     what was hidden; read after the diagnosis
    campaigns/0001/diagnosis.json  what it said
"""

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.amount import counted
from femfit.core.atomic import write_json
from femfit.core.errors import DomainError, MissingPartError
from femfit.core.processes import process_pool
from femfit.device.load import read_actuator
from femfit.device.parts import Actuator
from femfit.field.sweep import Progress, run_sweep
from femfit.fit.build import fit_model
from femfit.identify.decision.diagnose import diagnose
from femfit.model.json_file import read_model, write_model
from femfit.tables.measurement_file import read_measurement
from femfit.trial.hidden import Device, possible_errors, solve_device
from femfit.trial.virtual_bench import LEVELS, make_campaign

Report = Callable[[int, int], None]
"""Takes how many campaigns are done, and of how many."""

ONE, TWO = 0.45, 0.25
"""Part of the campaigns with one and with two hidden errors; the others hide nothing."""

_TWINS = {"force_offset": ("constant_force",)}
"""Effects that do the same to every channel of a bench as an error: left out of the catalogue together with it."""

_POINTED_AT = 0.5
"""A channel is a right answer to "where" if an error shows there by this part of the most it does anywhere."""


@dataclass(frozen=True)
class Outcome:
    """One campaign and what was said of it."""

    number: int
    hidden: tuple[str, ...]
    level: float
    verdict: str
    classes: tuple[tuple[str, ...], ...]  # Each name with what it cannot be told from, itself first
    found: tuple[bool, ...]  # Per hidden error, whether some class has it
    named_first: bool
    certain: bool
    spurious: int  # Classes without any hidden error
    right_channel: bool
    # With the hidden error out of the catalogue; None where that was not tried
    withheld_named: bool | None
    withheld_certain: bool | None


def prepare_device(drawing: Path, directory: Path, *, workers: int, progress: Progress | None = None) -> Device:
    """Sweep a drawing and fit its model as a user would; and solve its changed forms for the virtual bench."""
    actuator = read_actuator(drawing)
    _require_one_current(actuator)
    table = run_sweep(actuator, directory / "sweep", workers=workers, progress=progress)
    write_model(fit_model(table).model, directory / "model.json")
    return solve_device(actuator, directory / "forms", workers=workers, progress=progress)


def _require_one_current(actuator: Actuator) -> None:
    """Refuse at once what the virtual bench, which varies one current, cannot measure."""
    circuits = len(actuator.circuits)
    if circuits == len(actuator.coils) == 1:
        return
    has = (
        "no coil" if not actuator.coils else f"{counted(len(actuator.coils), 'coil')} in {counted(circuits, 'circuit')}"
    )
    raise MissingPartError(
        f"A trial needs a drawing of one coil, since its virtual bench varies one current and hides errors of its "
        f"winding; {actuator.name!r} has {has}. Ask femfit diagnose on a bench table of yours instead: it says what "
        "these readings would have shown, and how often it names something in clean ones."
    )


def make_campaigns(device: Device, directory: Path, cases: int, seed: int) -> list[int]:
    """Measure and write campaigns; the numbers of those in which the device can show what they were to hide."""
    rng = np.random.default_rng(seed)
    possible = possible_errors(device.actuator)
    turn: list[str] = []
    made = []
    for number in range(1, cases + 1):
        share = (number * 7) % 20 / 20.0  # twenty campaigns hold the shares exactly
        count = 1 if share < ONE else 2 if share < ONE + TWO else 0
        turn = turn if len(turn) >= count else [*turn, *(str(name) for name in rng.permutation(possible))]
        errors, turn = tuple(dict.fromkeys(turn[:count])), turn[count:]
        level = float(rng.choice(LEVELS)) if errors else 0.0
        try:
            campaign = make_campaign(device, errors, level, np.random.default_rng([seed, number]))
        except DomainError:
            continue
        place = directory / "campaigns" / f"{number:04d}"
        place.mkdir(parents=True, exist_ok=True)
        campaign.rows.to_csv(place / "data.csv", index=False, float_format="%.9g")
        key = {"level": level, "hidden": campaign.hidden, "over_noise": campaign.over_noise}
        write_json(place / "hidden.json", key)
        made.append(number)
    return made


def diagnose_campaigns(
    directory: Path, numbers: Sequence[int], *, workers: int, progress: Report | None = None
) -> list[Outcome]:
    """Diagnose and judge campaigns that were written, each from its files."""
    say = progress or (lambda _done, _total: None)
    solve = partial(_diagnose, directory)
    found: list[Outcome] = []
    say(0, len(numbers))
    if workers == 1:
        for number in numbers:
            found.append(solve(number))
            say(len(found), len(numbers))
        return found
    with process_pool(workers) as pool:
        for future in as_completed([pool.submit(solve, number) for number in numbers]):
            found.append(future.result())
            say(len(found), len(numbers))
    return sorted(found, key=lambda outcome: outcome.number)


def _diagnose(directory: Path, number: int) -> Outcome:
    place = directory / "campaigns" / f"{number:04d}"
    model, data = read_model(directory / "model.json"), read_measurement(place / "data.csv")
    said = diagnose(model, data, bootstrap=0).to_dict()
    write_json(place / "diagnosis.json", said)
    key = json.loads((place / "hidden.json").read_text(encoding="utf-8"))  # nothing above is changed from here on
    hidden = tuple(key["hidden"])
    withheld = None
    if len(hidden) == 1:
        withheld = diagnose(model, data, exclude=(*hidden, *_TWINS.get(hidden[0], ())), bootstrap=0).to_dict()
    return judge(number, key, said, withheld)


def judge(
    number: int, key: Mapping[str, Any], said: Mapping[str, Any], withheld: Mapping[str, Any] | None = None
) -> Outcome:
    """Compare the diagnosis with what was hidden; ``withheld`` is that without the hidden error in the catalogue."""
    hidden = tuple(key["hidden"])
    classes = tuple(tuple(one["class"]) for one in said["missing"])
    channels: set[str] = set()
    for shown in key["over_noise"].values():
        channels |= {name for name, size in shown.items() if size >= _POINTED_AT * max(shown.values())}
    return Outcome(
        number=number,
        hidden=hidden,
        level=key["level"],
        verdict=said["verdict"],
        classes=classes,
        found=tuple(any(name in members for members in classes) for name in hidden),
        named_first=bool(classes) and classes[0][0] in hidden,
        certain=bool(said["confident"]),
        spurious=sum(not set(members) & set(hidden) for members in classes),
        right_channel=said["where"]["channel"] in channels,
        withheld_named=None if withheld is None else bool(withheld["missing"]),
        withheld_certain=None if withheld is None else bool(withheld["confident"]),
    )
