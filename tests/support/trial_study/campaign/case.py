"""One case of the trial: an actuator, a campaign, no, one or two hidden effects, and what was measured."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray, IntArray
from femfit.core.errors import DomainError
from femfit.trial.virtual_bench import Meter, measured
from support.trial_study.campaign.noise import drawn_meters
from support.trial_study.campaign.plan import Plan, PlanOptions, drawn_options, make_plan
from support.trial_study.campaign.size import effect_over_noise, even_channels, size_for
from support.trial_study.truth.bench import Hidden, true_readings
from support.trial_study.truth.bench_effects import BENCH_EFFECTS, twins_of
from support.trial_study.truth.families import Truth

_COMPLETE = 0.6
"""Part of the campaigns that measure every channel and both temperatures."""

_TRIES = 40


@dataclass(frozen=True)
class Order:
    """What a case should hold.

    Parameters
    ----------
    effects : tuple of str
        Hidden effects; empty for a bench that is as drawn.
    """

    number: int
    actuator: str
    effects: tuple[str, ...]
    level: float
    seed: int


@dataclass(frozen=True, eq=False)
class Case:
    """A campaign as measured, with its sealed truth.

    Parameters
    ----------
    rows, unseen : DataFrame
        The bench table, and a further run that is kept back.
    declared_noise : mapping of str to float
        For the sidecar; empty where the repeats have to tell.
    key : mapping
        JSON-ready: effects, sizes, noise, and the rms of a perfect model on the unseen run.
    """

    order: Order
    rows: pd.DataFrame
    unseen: pd.DataFrame
    declared_noise: Mapping[str, float] = field(default_factory=dict)
    key: Mapping[str, Any] = field(default_factory=dict)


def make_case(truth: Truth, order: Order) -> Case:
    """Measure a case."""
    generator = np.random.default_rng([order.seed, order.number])
    for _ in range(_TRIES):
        options = drawn_options(truth, generator)
        needed = {BENCH_EFFECTS[name].column for name in order.effects}
        if "branch" in needed:
            options = replace(options, both_branches=True, distances=max(6, options.distances // 2))
        plan = make_plan(truth, replace(options, runs=options.runs + 1), generator)
        hidden = [BENCH_EFFECTS[name].build(truth, generator) for name in order.effects]
        clean = true_readings(truth, plan.points())
        complete = bool(generator.random() < _COMPLETE)
        channels = list(clean) if complete else _channels(list(clean), order, generator)
        meters = drawn_meters({name: clean[name] for name in channels}, generator)
        sizes = _sizes(truth, plan, hidden, order.level, meters)
        if sizes is not None:
            meters = {name: replace(meter, sigma=meter.sigma * sizes[1]) for name, meter in meters.items()}
            effects = list(zip(hidden, sizes[0], strict=True))
            plan, options = _told_from_mounts(plan, options, effects)
            return _measure(truth, order, (plan, options, complete), effects, meters, generator)
    raise DomainError(
        f"Case {order.number} must let {' and '.join(order.effects)} reach {order.level:g} noise sigmas; no campaign "
        f"of {order.actuator} did. Leave the effect out for this actuator."
    )


def _channels(available: Sequence[str], order: Order, generator: np.random.Generator) -> list[str]:
    """Force always, the others with some luck; what an effect needs is there."""
    luck = {"force_N": 1.0, "flux_linkage_Wb": 0.7, "hall_V": 0.75, "voltage_V": 0.5}
    chosen = [name for name in available if generator.random() < luck[name]]
    for name in order.effects:
        wanted = [channel for channel in BENCH_EFFECTS[name].channels if channel in available]
        if not set(wanted) & set(chosen):
            chosen.append(str(generator.choice(wanted)))
    return [name for name in available if name in chosen]


def _sizes(
    truth: Truth, plan: Plan, hidden: Sequence[Hidden], level: float, meters: Mapping[str, Meter]
) -> tuple[list[float], float] | None:
    """Sizes of the effects, and the factor by which all noise had to fall for them; None where none of three serves."""
    points = plan.points(remounts=False)
    for factor in (1.0, 0.5, 0.25):
        quieter = {name: replace(meter, sigma=factor * meter.sigma) for name, meter in meters.items()}
        sizes = [size_for(truth, points, one, level, quieter) for one in hidden]
        if np.isfinite(sizes).all():
            return sizes, factor
    return None


def _told_from_mounts(
    plan: Plan, options: PlanOptions, effects: Sequence[tuple[Hidden, float]]
) -> tuple[Plan, PlanOptions]:
    """The plan with mounts so repeatable that a zero error of the stage stands out of their mean by four deviations.

    One that does not is a re-mount like the others, and nobody could know it.
    """
    for hidden, size in effects:
        if hidden.name == "distance_offset" and options.mount_m > 0.0:
            largest = size * np.sqrt(options.runs * options.mounts_per_run) / 4.0
            share = min(1.0, float(largest / options.mount_m))
            return replace(plan, remount=share * plan.remount), replace(options, mount_m=share * options.mount_m)
    return plan, options


def _measure(
    truth: Truth,
    order: Order,
    planned: tuple[Plan, PlanOptions, bool],
    effects: Sequence[tuple[Hidden, float]],
    meters: Mapping[str, Meter],
    generator: np.random.Generator,
) -> Case:
    plan, options, complete = planned
    perfect = true_readings(truth, plan.points(remounts=False), effects)
    real = true_readings(truth, plan.points(), effects)
    rows = _settings(plan, order, complete, generator)
    for name, meter in meters.items():
        rows[name] = measured(real[name], meter, plan.run, generator)
    kept = plan.run == plan.run.max()
    floor = {name: _rms(rows[name].to_numpy()[kept] - perfect[name][kept]) for name in meters}
    lost = generator.random(len(rows)) < generator.uniform(0.0, 0.05)
    for name in meters:
        rows.loc[generator.random(len(rows)) < 0.005, name] = np.nan
    declared = {}
    if generator.random() < 0.5:
        declared = {name: float(f"{meter.sigma:.3g}") for name, meter in meters.items()}
    points = plan.points(remounts=False)
    key = {
        "order": asdict(order),
        "all_channels": complete,
        "effects": [
            {
                "name": one.name,
                "size": size,
                "unit": one.unit,
                "constants": dict(one.constants),
                "over_noise": effect_over_noise(truth, points, one, size, meters),
                "along": list(BENCH_EFFECTS[one.name].along),
                "even": even_channels(truth, points, one, size),
                "twins": list(twins_of(one.name)),
            }
            for one, size in effects
        ],
        "meters": {name: asdict(meter) for name, meter in meters.items()},
        "plan": asdict(options),
        "unseen_floor": floor,
    }
    table = rows[~lost & ~kept].reset_index(drop=True)
    return Case(order, table, rows[kept].reset_index(drop=True), declared, key)


def _settings(plan: Plan, order: Order, complete: bool, generator: np.random.Generator) -> pd.DataFrame:
    """The columns that say where and when; temperatures as a probe reads them."""
    data: dict[str, FloatArray | IntArray] = {
        "run": plan.run + 1,
        "mount": plan.mount + 1,
        "order": plan.order + 1,
        "current_A": np.round(plan.current, 6),
        "distance_m": plan.distance,
    }
    if len(np.unique(plan.branch)) > 1:
        data["branch"] = plan.branch.astype(int)
    needed = {BENCH_EFFECTS[name].column for name in order.effects}
    for name, true in (
        ("coil_temperature_C", plan.temperatures.coil),
        ("magnet_temperature_C", plan.temperatures.magnet),
    ):
        if complete or name in needed or generator.random() < 0.7:
            data[name] = np.round(true + 0.05 * generator.standard_normal(len(true)), 1)
    return pd.DataFrame(data)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
