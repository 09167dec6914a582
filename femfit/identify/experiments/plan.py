"""What a planned campaign could never tell apart, and what it could not show at all, before anyone measures."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.effect import Effect
from femfit.identify.comparison.lack_of_fit import pattern_space
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.magnitude import detectable_magnitudes
from femfit.identify.experiments.suggest import unlike
from femfit.identify.noise.whitening import NoiseModel, Whitening, chains_of
from femfit.identify.readings.bench import bench_observations
from femfit.identify.refit.start import Start
from femfit.identify.signatures.columns import EffectColumns, effect_columns, why_untestable
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import BenchTable

_SPLIT = 4.0
_SMALL = 3.0
"""A small effect, over the smallest that the plan would show."""

_MOUNT_M, _RUN = 40e-6, 0.2
"""Scatter of mounts, and of runs over a channel's noise, that a plan assumes."""

_GUESSED_NOISE = 2e-3
"""Of a channel without declared noise, over its largest reading."""


@dataclass(frozen=True)
class PlanReport:
    """What a plan can show.

    Parameters
    ----------
    detectable : mapping of str to mapping of str to float
        As in :class:`femfit.identify.decision.diagnosis.Diagnosis`.
    groups : tuple of tuple of str
        Effects that stay together even at the largest usual size of each.
    small_groups : tuple of tuple of str
        Those that stay together at three times the smallest size that the plan would show.
    invisible : mapping of str to str
        Effects that the plan cannot show at their largest usual size, and why.
    """

    noise: dict[str, float]
    detectable: dict[str, dict[str, float]]
    groups: tuple[tuple[str, ...], ...]
    small_groups: tuple[tuple[str, ...], ...]
    invisible: dict[str, str]

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return asdict(self)


def examine_plan(model: ActuatorModel, plan: BenchTable, effects: Sequence[Effect], level: float = 0.01) -> PlanReport:
    """Tell what a planned bench campaign could not show or separate.

    Parameters
    ----------
    plan : BenchTable
        Settings; its channels are those to be read, whatever their values. Declared noise counts.
    level : float
        False-naming rate of the diagnosis.

    Returns
    -------
    PlanReport
        Two effects stay together at a size where the one is made by the other within four standard deviations.
    """
    rows = plan.rows.assign(**dict.fromkeys(plan.channels, 0.0))
    observations = bench_observations(model, replace(plan, rows=rows))
    observations = observations.with_values(observations.base)
    channels = observations.channels
    sigma = np.array(
        [
            plan.declared_noise.get(
                name, _GUESSED_NOISE * float(np.abs(observations.base[observations.of(name)]).max())
            )
            for name in channels
        ]
    )
    zeros, many = np.zeros(len(channels)), np.full(len(channels), np.inf)
    source = {name: "declared" if name in plan.declared_noise else "assumed" for name in channels}
    noise = NoiseModel(channels, sigma, zeros, _MOUNT_M, _RUN * sigma, many, many, source, _MOUNT_M, _RUN * sigma)
    whitening = Whitening(observations, noise, chains_of(observations))
    invisible: dict[str, str] = {}
    columns: list[tuple[EffectColumns, FloatArray]] = []
    for effect in effects:
        reason = why_untestable(effect, observations)
        found = [] if reason else effect_columns(effect, observations)
        white = [(one, whitening.full(one.columns)) for one in found]
        if not any(_signals(one, w) for one, w in white):
            invisible[effect.name] = reason or "its largest usual size stays within the noise"
            continue
        columns += white
    starts = tuple(Start(one, white, np.zeros(len(one.amplitudes))) for one, white in columns)
    campaign = Campaign(observations, whitening, pattern_space(observations, whitening), starts, invisible)
    detectable = detectable_magnitudes(campaign, level)
    small = {name: {p: _SMALL * size for p, size in sizes.items()} for name, sizes in detectable.items()}
    return PlanReport(noise.floor, detectable, _groups(columns), _groups(columns, small), invisible)


def _signals(one: EffectColumns, white: FloatArray, size: Mapping[str, float] | None = None) -> list[FloatArray]:
    """Each shape that can be seen at the further end of its usual range, or at a smaller size."""
    result = []
    for k, p in enumerate(one.amplitudes):
        end = max((end - p.null for end in p.plausible), key=abs)
        if size is not None and size[p.name] < abs(end):
            end = float(np.copysign(size[p.name], end))
        result.append(white[:, k] * end)
    return [signal for signal in result if np.linalg.norm(signal) > _SPLIT]


def _groups(
    columns: Sequence[tuple[EffectColumns, FloatArray]], sizes: Mapping[str, Mapping[str, float]] | None = None
) -> tuple[tuple[str, ...], ...]:
    names = list(dict.fromkeys(one.effect.name for one, _ in columns))
    variants = {name: [(one, white) for one, white in columns if one.effect.name == name] for name in names}
    leader = {name: name for name in names}
    for a in names:
        signals = _signals(*variants[a][0], sizes[a] if sizes else None)
        for b in names:
            if a != b and leader[a] != leader[b] and _made_by(signals, variants[b]):
                old, new = leader[a], leader[b]
                leader = {name: new if top == old else top for name, top in leader.items()}
    groups = [tuple(name for name in names if leader[name] == top) for top in dict.fromkeys(leader.values())]
    return tuple(group for group in groups if len(group) > 1)


def _made_by(signals: Sequence[FloatArray], rivals: Sequence[tuple[EffectColumns, FloatArray]]) -> bool:
    """Whether every visible shape of an effect can be made by another within the split."""
    return bool(signals) and all(min(unlike(signal, [rival]) for rival in rivals) < _SPLIT for signal in signals)
