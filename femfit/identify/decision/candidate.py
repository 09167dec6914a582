"""A candidate explanation: one effect, or two, refitted within bounds and tested again."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.ties import ranked
from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.lack_of_fit import LackOfFit
from femfit.identify.constants import CONTINUED, LEVEL_AFTER, NONLINEAR_PRICE, ROUNDING, STRUCTURE_LEFT
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.scoring import further_effects, parameter_price
from femfit.identify.refit.refit import Refit, is_plausible, refit
from femfit.identify.refit.start import Start


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect, or two, refitted to the readings."""

    fit: Refit
    cost: float  # Weighted sum of squares plus a price for every parameter
    excess: float  # Squared length of the whitened residual in the smooth patterns beyond what noise gives
    lack_of_fit: LackOfFit
    beyond_own_misfit: float  # P-value of the same test where the model's own misfit to its table is allowed for
    # Probability of so large a residual, as recorded, where noise, mounts, runs and that misfit are all that is left
    as_recorded: float
    further: float  # Smallest p-value of a further effect beside it, with that allowance, times the amplitudes tried
    beside: tuple[Start, ...]  # The best of the other effects as they would go on from here, best first

    @property
    def plausible(self) -> bool:
        """Whether every parameter has a usual size."""
        return all(is_plausible(one, p) for one in self.fit.effects for p in one.effect.parameters)

    def passes(self, level: float = LEVEL_AFTER) -> bool:
        """Whether it leaves neither structure beyond the model's own misfit nor anything for a further effect."""
        return min(self.beyond_own_misfit, self.as_recorded, self.further) > level


def refitted_candidates(campaign: Campaign, starts: Sequence[Sequence[Start]]) -> list[Candidate]:
    """Refit combinations of effects, each with amplitudes to start from; the cheapest comes first."""
    place = {name: k for k, name in enumerate(dict.fromkeys(one.name for one in campaign.effects))}
    candidates = [_best_refit(campaign, start) for start in starts]
    candidates.sort(key=lambda one: sorted(place[name] for name in one.fit.names))
    return ranked(candidates, lambda one: -one.cost, ROUNDING)


def forward_pairs(singles: Sequence[Candidate], leading: int) -> list[list[Start]]:
    """Pairs of a refitted effect, one of the leading ones, and what goes on best from it.

    A first-order score misses an effect whose nonlinear parameters are far from where its columns were taken; a refit
    does not.
    """
    return [
        [one.fit.start[0].continued(one.fit.effects[0]), second] for one in singles[:leading] for second in one.beside
    ]


def _best_refit(campaign: Campaign, start: Sequence[Start]) -> Candidate:
    """The refit of a combination; with all amplitudes of its effects where that is cheaper and structure was left.

    Amplitudes that did not pay for themselves to first order may do so about the refit.
    """
    one = _refitted(campaign, start)
    if one.passes(STRUCTURE_LEFT):
        return one
    whole = [_whole_family(campaign, *pair) for pair in zip(one.fit.effects, start, strict=True)]
    if sum(item.count for item in whole) <= sum(item.count for item in start):
        return one
    other = _refitted(campaign, whole)
    return other if other.cost < one.cost - ROUNDING else one


def _refitted(campaign: Campaign, start: Sequence[Start]) -> Candidate:
    fit = refit(campaign.observations, campaign.whitening, start)
    # A nonlinear parameter that ended at its bound was searched for as well; it matters less than an amplitude
    amplitudes = sum(not p.nonlinear and not bound for (_, p), bound in zip(fit.free, fit.active, strict=True))
    nonlinear = sum(p.nonlinear for _, p in fit.free)
    fitted = fit.jacobian[:, ~fit.active]
    beside, further = further_effects(campaign, fit.names, fit.whitened_residual, fitted)
    return Candidate(
        fit=fit,
        cost=fit.chi2 + parameter_price(fit.whitened_residual) * (amplitudes + NONLINEAR_PRICE * nonlinear),
        excess=campaign.patterns.excess(fit.whitened_residual, fitted),
        lack_of_fit=campaign.patterns.test(fit.whitened_residual, fitted),
        beyond_own_misfit=campaign.patterns.test(fit.whitened_residual, fitted, campaign.expected_variance).p_value,
        as_recorded=campaign.chance_as_recorded(
            campaign.observations.value - campaign.observations.predict(fit.effects)
        ),
        further=further,
        beside=tuple(beside[:CONTINUED]),  # a hundred columns of all readings each would be kept for nothing
    )


def _whole_family(campaign: Campaign, added: AddedEffect, start: Start) -> Start:
    """All amplitudes of an effect, those that a refit used as it left them; what goes with another one, as begun."""
    variants = [one for one in campaign.effects if one.name == added.effect.name]
    whole = variants[int(np.argmax([one.count for one in variants]))]
    begun = {p.name for p in start.columns.amplitudes}
    kept = [k for k, p in enumerate(whole.columns.amplitudes) if not p.beside or p.name in begun]
    return whole.part(kept).continued(added)
