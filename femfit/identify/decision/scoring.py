"""How much each effect alone explains to first order: the ranking beside the verdict."""

from femfit.core.ties import ranked
from femfit.identify.comparison.lack_of_fit import tail_probability
from femfit.identify.constants import ROUNDING
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.diagnosis import ScoredEffect
from femfit.identify.refit.start import bounded_amplitudes


def score_effects(campaign: Campaign) -> tuple[ScoredEffect, ...]:
    """Every effect alone, at its best nonlinear parameters, the least probable by chance first.

    The p-value counts times the number of combinations of nonlinear parameters that were tried (Bonferroni).
    """
    residual, degrees = campaign.whitened_residual, campaign.patterns.degrees_of_freedom
    best: dict[str, tuple[float, int]] = {}
    tries: dict[str, int] = {}
    for one in campaign.effects:
        _, fall = bounded_amplitudes(residual, one.whitened, one.columns.bounds)
        tries[one.name] = tries.get(one.name, 0) + 1
        best[one.name] = max(best.get(one.name, (0.0, one.count)), (fall, one.count))
    scores = [
        ScoredEffect(name, min(1.0, tries[name] * tail_probability(fall, count, degrees)), fall, count)
        for name, (fall, count) in best.items()
    ]
    absent = (ScoredEffect(name, 1.0, 0.0, 0, note=why) for name, why in campaign.untestable.items())
    return (*ranked(scores, lambda one: one.chi2_fall - one.degrees_of_freedom, ROUNDING), *absent)
