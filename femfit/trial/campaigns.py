"""Campaigns made for a trial or a calibration: solve the device and its truths, hide errors, measure, write.

::

    model.json                     what a diagnosis compares with
    campaigns/0001/data.csv        what was measured
    campaigns/0001/data.toml       its noise, where that is declared
    campaigns/0001/hidden.json     what was hidden
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from femfit.core.amount import counted
from femfit.core.atomic import write_json
from femfit.core.errors import DomainError, FieldSolverError, MissingPartError
from femfit.device.load import read_actuator
from femfit.device.parts import Actuator
from femfit.device.variants import only, read_variants
from femfit.field.sweep import Progress, run_sweep
from femfit.fit.build import fit_model
from femfit.model.json_file import write_model
from femfit.trial.device import Device, Family, HiddenError
from femfit.trial.field_table import solve_drawings
from femfit.trial.habits import Habits, drawn_habits
from femfit.trial.hidden import HIDDEN_ERRORS, possible_errors, solve_device
from femfit.trial.truths.sets import SETS, SetName, truths_of
from femfit.trial.truths.truth import Group, Truth
from femfit.trial.virtual_bench import LEVELS, Campaign, make_campaign

ONE, TWO = 0.45, 0.25
"""Part of the campaigns with one and with two usual errors; the others hide nothing."""

_TURN: tuple[tuple[Group, ...], ...] = (
    (), ("catalogue",), ("drawing",), ("catalogue",), (), ("when",), ("catalogue", "catalogue"), ("unseen",),
    ("catalogue",), (), ("drawing",), ("catalogue", "drawing"), ("catalogue",), (), ("when",), ("unseen",),
    ("catalogue",), ("drawing",), (), ("catalogue", "catalogue"),
)  # fmt: skip
"""What twenty campaigns of a set hide."""


@dataclass(frozen=True)
class TruthSet:
    """The truths of a set that a device can show, and why it cannot show the others."""

    name: SetName
    truths: Mapping[str, Truth]
    left_out: Mapping[str, str] = field(default_factory=dict)

    def reasons(self) -> dict[str, list[str]]:
        """What is left out, by the reason, in short names."""
        found: dict[str, list[str]] = {}
        for name, reason in self.left_out.items():
            found.setdefault(reason, []).append(name.partition(" (")[0])
        return found


def prepare_device(drawing: Path, directory: Path, *, workers: int, progress: Progress | None = None) -> Device:
    """Sweep a drawing and fit its model as a user would; and solve its changed forms for the virtual bench.

    The model has the numbers of the drawing as suspects, where it is one drawing and no sweep of variants.
    """
    actuator = read_actuator(drawing)
    _require_one_current(actuator)
    suspects = read_variants(drawing) == only(actuator)
    swept = drawing if suspects else actuator
    table = run_sweep(swept, directory / "sweep", workers=workers, progress=progress, signatures=suspects)
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


def prepare_set(
    drawing: Path, device: Device, directory: Path, name: SetName, *, workers: int, progress: Progress | None = None
) -> tuple[Device, TruthSet]:
    """Solve the changed drawings of a set's truths; the device with their fields, and the truths that it can show."""
    families, possible, left_out = dict(device.families), {}, {}
    for truth_name, truth in truths_of(drawing, name).items():
        reason = truth.lacks(device.actuator)
        try:
            for family, forms in () if reason else truth.families(device.actuator).items():
                if family not in families:
                    families[family] = _solved(device, family, forms, directory, workers, progress)
        except FieldSolverError as error:
            reason = str(error)
        if reason:
            left_out[truth_name] = reason
        else:
            possible[truth_name] = truth
    return replace(device, families=families), TruthSet(name, possible, left_out)


def _solved(
    device: Device,
    family: str,
    forms: Mapping[float, Actuator],
    directory: Path,
    workers: int,
    progress: Progress | None,
) -> Family:
    place = directory / "truths" / re.sub(r"[^\w.-]+", "_", family)
    drawings = {f"{value:+.6g}": form for value, form in forms.items()}
    tables = solve_drawings(drawings, place, workers=workers, progress=progress)
    return Family(tuple(forms), tuple(tables.values()), device.drawn)


def make_campaigns(device: Device, directory: Path, cases: int, seed: int, truths: TruthSet | None = None) -> list[int]:
    """Measure and write campaigns, of the usual errors or of a set's truths.

    Returns
    -------
    list of int
        Numbers of those in which the device can show what they were to hide.
    """
    made = []
    for number, campaign, errors in measured_campaigns(device, cases, seed, truths):
        write_campaign(campaign, directory / "campaigns" / f"{number:04d}", errors, truths)
        made.append(number)
    return made


def measured_campaigns(
    device: Device, cases: int, seed: int, truths: TruthSet | None = None
) -> Iterator[tuple[int, Campaign, Mapping[str, HiddenError]]]:
    """Measure campaigns: the number of each, what was measured and what it hides, where the device can show that."""
    orders = _usual_orders(device.actuator, cases, seed) if truths is None else _orders(truths, cases, seed)
    part = 0 if truths is None else 1 + SETS.index(truths.name)
    for number, (names, level) in enumerate(orders, 1):
        rng = np.random.default_rng([seed, number, part] if part else [seed, number])
        habits = drawn_habits(rng) if truths else Habits()
        errors = {name: truths.truths[name].build(device, rng) if truths else HIDDEN_ERRORS[name] for name in names}
        try:
            campaign = make_campaign(device, errors, level, rng, habits)
        except DomainError:
            continue
        yield number, campaign, errors


def _usual_orders(actuator: Actuator, cases: int, seed: int) -> list[tuple[tuple[str, ...], float]]:
    """What each campaign hides of the usual errors, and at which level."""
    rng = np.random.default_rng(seed)
    possible = possible_errors(actuator)
    turn: list[str] = []
    orders = []
    for number in range(1, cases + 1):
        share = (number * 7) % 20 / 20.0  # twenty campaigns hold the shares exactly
        count = 1 if share < ONE else 2 if share < ONE + TWO else 0
        turn = turn if len(turn) >= count else [*turn, *(str(name) for name in rng.permutation(possible))]
        errors, turn = tuple(dict.fromkeys(turn[:count])), turn[count:]
        orders.append((errors, float(rng.choice(LEVELS)) if errors else 0.0))
    return orders


def _orders(truths: TruthSet, cases: int, seed: int) -> list[tuple[tuple[str, ...], float]]:
    """The same of a set: going round each group's truths in random order."""
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


def write_campaign(campaign: Campaign, place: Path, errors: Mapping[str, HiddenError], truths: TruthSet | None) -> None:
    """Write a campaign's files into a directory."""
    place.mkdir(parents=True, exist_ok=True)
    campaign.rows.to_csv(place / "data.csv", index=False, float_format="%.9g")
    noise = "".join(f"{channel} = {sigma:.4g}\n" for channel, sigma in campaign.declared_noise.items())
    (place / "data.toml").unlink(missing_ok=True)
    if noise:
        (place / "data.toml").write_text(noise, encoding="utf-8")
    key = campaign.key() | {
        "set": truths.name if truths else "usual",
        "right": {name: list(right_names(name, error)) for name, error in errors.items()},
        "group": {name: truths.truths[name].group if truths else "catalogue" for name in errors},
        "constants": {name: dict(error.constants) for name, error in errors.items()},
    }
    write_json(place / "hidden.json", key)


def right_names(name: str, error: HiddenError) -> Sequence[str]:
    """Names of the diagnosis that say what is hidden."""
    return error.names if error.names is not None else (name.partition(" (")[0],)
