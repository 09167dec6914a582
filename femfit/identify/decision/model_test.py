"""Whether a model explains the readings: the one test that ``femfit compare`` and ``femfit diagnose`` share."""

import math
from dataclasses import dataclass
from typing import Literal

from femfit.identify.comparison.lack_of_fit import LackOfFit
from femfit.identify.constants import LEVEL, OWN_MISFIT
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.diagnosis import ScoredEffect
from femfit.identify.decision.scoring import score_effects
from femfit.identify.refit.start import Start

Outcome = Literal["fits", "own_misfit", "fails"]


@dataclass(frozen=True, eq=False)
class ModelTest:
    """The test of a model: of smooth patterns, and of every effect's columns."""

    # ``fits`` within the noise; ``own_misfit`` where it misses the readings no more than the table that it was fitted
    # to; else ``fails``
    outcome: Outcome
    lack_of_fit: LackOfFit
    p_value: float  # For both tests together (Bonferroni)
    excess: float  # Squared length of the whitened residual beyond what noise gives
    times_own: float  # The misfit beyond noise over the model's own to its table; infinite where that is none
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
    square, known = max(excess, campaign.misfit_as_recorded), campaign.known_misfit
    times_own = math.sqrt(square / known) if known > 0.0 else math.inf
    outcome: Outcome = "fits" if p_value > LEVEL else "own_misfit" if square < OWN_MISFIT * known else "fails"
    return ModelTest(outcome, patterns, p_value, excess, times_own, scores, starts)
