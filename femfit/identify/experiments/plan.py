"""What a planned campaign could never separate, and what it could not show at all, before anyone measures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.amount import amount
from femfit.core.printed import Printed
from femfit.effects.catalogue import all_effects
from femfit.effects.effect import Effect
from femfit.effects.words import smallest_visible, titled, titles_of
from femfit.identify.comparison.lack_of_fit import pattern_space
from femfit.identify.comparison.patterns import own_misfit_columns
from femfit.identify.constants import LEVEL
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.magnitude import detectable_magnitudes
from femfit.identify.experiments.constants import SMALL, TIE, VISIBLE
from femfit.identify.experiments.noise import planned_noise
from femfit.identify.experiments.separation import pairs_in_words, separation, starting_points
from femfit.identify.noise.whitening import Whitening, chains_of
from femfit.identify.readings.bench import bench_observations
from femfit.identify.refit.start import Start
from femfit.identify.signatures.columns import why_untestable
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import CHANNEL_WORDS, BenchTable
from femfit.tables.measurement_file import read_bench_table


@dataclass(frozen=True, eq=False, repr=False)
class PlanReport(Printed):
    """What a plan can show; printed, it is what ``femfit suggest --plan`` prints."""

    noise: dict[str, float]  # Standard deviation of one reading per channel, as assumed or declared
    # Smallest magnitude of each effect's amplitudes that the plan would show nine times in ten
    detectable: dict[str, dict[str, float]]
    # Pairs of effects of which the one could be taken for the other even at its largest plausible size
    together: tuple[tuple[str, str], ...]
    small_together: tuple[tuple[str, str], ...]  # The same at three times the smallest size that the plan would show
    invisible: dict[str, str]  # Effects that the plan cannot show at their largest plausible size, and why
    # Per effect its smallest visible size in words, and the measurement that would read it directly
    smallest: dict[str, str]
    direct: dict[str, str]
    titles: dict[str, str]  # What texts call the numbers of the drawing

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return dict(vars(self))

    def __str__(self) -> str:
        return titled(self._text(), self.titles)

    def _text(self) -> str:
        lines = ["This plan could separate every effect that it shows from every other, at its largest size."]
        if self.together:
            lines = ["This plan could never separate, however large they usually get:"]
            lines += [f"  {clause}" for clause in pairs_in_words(self.together)]
            named = dict.fromkeys(name for pair in self.together for name in pair if name in self.direct)
            lines += ["What would:"] * bool(named) + [f"  {name}: {self.direct[name]}" for name in named]
        more = [pair for pair in self.small_together if pair not in self.together]
        if more:
            lines.append("Nor these where they are small, at three times the sizes below:")
            lines += [f"  {clause}" for clause in pairs_in_words(more)]
        if self.invisible:
            lines.append("It could not show:")
            reasons = dict.fromkeys(self.invisible.values())
            lines += [f"  {', '.join(n for n, w in self.invisible.items() if w == why)}: {why}" for why in reasons]
        lines.append("The smallest that it would show nine times in ten:")
        lines += [f"  {name}: {words or 'nothing within its bounds'}" for name, words in self.smallest.items()]
        noise = ", ".join(f"{CHANNEL_WORDS[name]} {amount(sigma, name)}" for name, sigma in self.noise.items())
        return "\n".join([*lines, f"Noise of one reading: {noise}."])


def examine_plan(
    model: ActuatorModel, plan: BenchTable | str | Path, effects: Sequence[Effect] | None = None
) -> PlanReport:
    """Say what a planned bench campaign could not show or separate."""
    plan = read_bench_table(Path(plan), planned=True) if isinstance(plan, str | Path) else plan
    effects = list(all_effects().values()) if effects is None else effects
    rows = plan.rows.assign(**dict.fromkeys(plan.channels, 0.0))
    observations = bench_observations(model, replace(plan, rows=rows))
    observations, nominal = observations.with_values(observations.base), observations.nominal
    noise = planned_noise(observations)
    whitening = Whitening(observations, noise, chains_of(observations), own_misfit_columns(observations))
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
        together=_together(campaign, families, {}),
        small_together=_together(campaign, families, small),
        invisible=invisible,
        smallest={e.name: smallest_visible(e, detectable[e.name], nominal) for e in effects if e.name in detectable},
        direct={effect.name: effect.calibrations[0].instruction for effect in effects if effect.calibrations},
        titles=titles_of(effects),
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


def _together(
    campaign: Campaign, families: Mapping[str, list[Start]], sizes: Mapping[str, Mapping[str, float]]
) -> tuple[tuple[str, str], ...]:
    """Pairs of effects of which one can make every visible amplitude of the other: a diagnosis would leave both."""
    signals = {name: _signals(starts[0], sizes.get(name)) for name, starts in families.items()}

    def could_be(effect: str, rival: str) -> bool:
        columns, rivals = families[effect][0].columns.columns, [[one] for one in families[rival]]
        return bool(signals[effect]) and all(
            separation(campaign.observations, campaign.whitening, value * columns[:, k], rivals, TIE) is None
            for value, k in signals[effect]
        )

    return tuple((a, b) for a, b in combinations(families, 2) if could_be(a, b) or could_be(b, a))
