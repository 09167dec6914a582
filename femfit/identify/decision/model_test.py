"""Whether a model explains the readings: the one test that ``femfit compare`` and ``femfit diagnose`` share."""

from dataclasses import dataclass
from typing import Literal

from femfit.identify.comparison.lack_of_fit import LackOfFit
from femfit.identify.constants import LEVEL, OWN_MISFIT
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.diagnosis import ScoredEffect
from femfit.identify.decision.scoring import score_effects
from femfit.identify.refit.start import Start


@dataclass(frozen=True, eq=False)
class ModelTest:
    """The test of a model: of smooth patterns, and of every effect's columns."""

    # ``fits`` within the noise; ``own_misfit`` where it misses the readings no more than the table that it was fitted
    # to; else ``fails``
    outcome: Literal["fits", "own_misfit", "fails"]
    lack_of_fit: LackOfFit
    p_value: float  # For both tests together (Bonferroni)
    excess: float  # Squared length of the whitened residual beyond what noise gives
    scores: tuple[ScoredEffect, ...]
    starts: list[Start]


def judge_model(campaign: Campaign) -> ModelTest:
    """Test a model against its readings."""
    residual = campaign.whitened_residual
    patterns = campaign.patterns.test(residual)
    scores, starts = score_effects(campaign, residual)
    # What the patterns cannot see of an effect between them counts as well
    excess = max(campaign.patterns.excess(residual), *(s.chi2_fall - s.degrees_of_freedom for s in scores), 0.0)
    smallest = min((s.p_value for s in scores), default=1.0) * max(len(starts), 1)
    p_value = min(1.0, 2.0 * min(patterns.p_value, smallest))
    if p_value > LEVEL:
        return ModelTest("fits", patterns, p_value, excess, scores, starts)
    own = max(excess, campaign.misfit_as_recorded) < OWN_MISFIT * campaign.known_misfit
    return ModelTest("own_misfit" if own else "fails", patterns, p_value, excess, scores, starts)
