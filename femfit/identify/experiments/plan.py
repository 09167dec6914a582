"""What a planned campaign could never separate, and what it could not show at all, before anyone measures."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.amount import amount
from femfit.core.ties import ROUNDING
from femfit.effects.catalogue import all_effects
from femfit.effects.conditions import Nominal
from femfit.effects.effect import Effect
from femfit.effects.words import smallest_visible
from femfit.identify.comparison.lack_of_fit import pattern_space
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.constants import LEVEL
from femfit.identify.decision.magnitude import detectable_magnitudes
from femfit.identify.experiments.constants import SMALL, VISIBLE
from femfit.identify.experiments.noise import planned_noise
from femfit.identify.experiments.separation import needed_distance, starting_points, unexplained
from femfit.identify.noise.whitening import Whitening, chains_of
from femfit.identify.readings.bench import bench_observations
from femfit.identify.refit.start import Start
from femfit.identify.signatures.columns import why_untestable
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import BenchTable
from femfit.tables.measurement_file import read_bench_table


@dataclass(frozen=True)
class PlanReport:
    """What a plan can show; printed, it is what ``femfit suggest --plan`` prints.

    Parameters
    ----------
    noise : mapping of str to float
        Standard deviation of one reading per channel, as assumed or declared.
    detectable : mapping of str to mapping of str to float
        Smallest magnitude of each effect's amplitudes that the plan would show nine times in ten.
    groups : tuple of tuple of str
        Effects that stay together even at the largest plausible size of each.
    small_groups : tuple of tuple of str
        Those that stay together at three times the smallest size that the plan would show.
    invisible : mapping of str to str
        Effects that the plan cannot show at their largest plausible size, and why.
    """

    noise: dict[str, float]
    detectable: dict[str, dict[str, float]]
    groups: tuple[tuple[str, ...], ...]
    small_groups: tuple[tuple[str, ...], ...]
    invisible: dict[str, str]
    nominal: Nominal = field(repr=False)
    effects: Mapping[str, Effect] = field(repr=False, default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        names = ("noise", "detectable", "groups", "small_groups", "invisible")
        return {name: value for name, value in asdict(replace(self, effects={})).items() if name in names}

    def __str__(self) -> str:
        lines = []
        if self.groups:
            lines.append("This plan could never separate, however large they usually get:")
            for group in self.groups:
                lines.append(f"  {', '.join(group)}")
                lines += [f"    {text}" for text in map(self._direct_reading, group) if text]
        else:
            lines.append("This plan could separate every effect that it shows from every other, at its largest size.")
        more = [group for group in self.small_groups if group not in self.groups]
        if more:
            lines.append("Nor these where they are small, at three times the sizes below:")
            lines += [f"  {', '.join(group)}" for group in more]
        if self.invisible:
            lines.append("It could not show:")
            reasons = dict.fromkeys(self.invisible.values())
            lines += [f"  {', '.join(n for n, w in self.invisible.items() if w == why)}: {why}" for why in reasons]
        lines.append("The smallest that it would show nine times in ten:")
        for name, magnitudes in self.detectable.items():
            said = smallest_visible(self.effects[name], magnitudes, self.nominal) if name in self.effects else ""
            lines.append(f"  {name}: {said or 'nothing within its bounds'}")
        noise = ", ".join(f"{name} {amount(sigma, name)}" for name, sigma in self.noise.items())
        return "\n".join([*lines, f"Noise of one reading: {noise}."])

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"

    def _direct_reading(self, name: str) -> str:
        readings = self.effects[name].calibrations if name in self.effects else ()
        return readings[0].instruction if readings else ""


def examine_plan(
    model: ActuatorModel, plan: BenchTable | str | Path, effects: Sequence[Effect] | None = None
) -> PlanReport:
    """Say what a planned bench campaign could not show or separate."""
    plan = read_bench_table(Path(plan), planned=True) if isinstance(plan, str | Path) else plan
    effects = list(all_effects().values()) if effects is None else effects
    rows = plan.rows.assign(**dict.fromkeys(plan.channels, 0.0))
    observations = bench_observations(model, replace(plan, rows=rows))
    observations = observations.with_values(observations.base)
    noise = planned_noise(observations)
    whitening = Whitening(observations, noise, chains_of(observations))
    invisible: dict[str, str] = {}
    families: dict[str, list[Start]] = {}
    for effect in effects:
        reason = why_untestable(effect, observations)
        variants = [] if reason else [start for (start,) in starting_points([effect], observations, whitening)]
        if any(_signals(one) for one in variants):
            families[effect.name] = variants
        else:
            invisible[effect.name] = reason or "its largest plausible size stays within the noise"
    starts = tuple(one for variants in families.values() for one in variants)
    campaign = Campaign(observations, whitening, pattern_space(observations, whitening), starts, invisible)
    detectable = detectable_magnitudes(campaign, LEVEL)
    small = {name: {p: SMALL * size for p, size in sizes.items()} for name, sizes in detectable.items()}
    return PlanReport(
        noise=noise.floor,
        detectable=detectable,
        groups=_groups(campaign, families, {}),
        small_groups=_groups(campaign, families, small),
        invisible=invisible,
        nominal=observations.nominal,
        effects={effect.name: effect for effect in effects},
    )


def _signals(start: Start, sizes: Mapping[str, float] | None = None) -> list[tuple[float, int]]:
    """(value, number) of each amplitude that can be seen at the further end of its plausible range, or smaller."""
    result = []
    for k, p in enumerate(start.columns.amplitudes):
        end = max((end - p.null for end in p.plausible), key=abs)
        if sizes and sizes[p.name] < abs(end):
            end = float(np.copysign(sizes[p.name], end))
        if np.linalg.norm(start.whitened[:, k] * end) > VISIBLE:
            result.append((end, k))
    return result


def _groups(
    campaign: Campaign, families: Mapping[str, list[Start]], sizes: Mapping[str, Mapping[str, float]]
) -> tuple[tuple[str, ...], ...]:
    names = list(families)
    leader = {name: name for name in names}
    for a in names:
        signals = _signals(families[a][0], sizes.get(a))
        for b in names:
            if a != b and leader[a] != leader[b] and signals and _all_made_by(campaign, families, a, b, signals):
                old, new = leader[a], leader[b]
                leader = {name: new if top == old else top for name, top in leader.items()}
    groups = [tuple(name for name in names if leader[name] == top) for top in dict.fromkeys(leader.values())]
    return tuple(group for group in groups if len(group) > 1)


def _all_made_by(
    campaign: Campaign,
    families: Mapping[str, list[Start]],
    effect: str,
    rival: str,
    signals: Sequence[tuple[float, int]],
) -> bool:
    """Whether another effect can make every visible amplitude of an effect, so that no diagnosis would leave it out."""
    observations, whitening, start = campaign.observations, campaign.whitening, families[effect][0]
    for value, k in signals:
        change = value * start.columns.columns[:, k]
        needed = needed_distance(len(change))
        seen = observations.with_values(observations.base + change)
        if unexplained(seen, whitening, [[one] for one in families[rival]], needed) >= needed * (1.0 - ROUNDING):
            return False
    return True
