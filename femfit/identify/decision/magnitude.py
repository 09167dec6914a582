"""What a campaign can show of each effect, and how far an effect lowers the error on runs that it was not fitted to.

References
----------
J. Cohen, Statistical Power Analysis for the Behavioral Sciences (Erlbaum, 1988), chapter 12: noncentral chi-square.
M. Stone, Journal of the Royal Statistical Society B 36 (1974) 111: cross-validation.
"""

import numpy as np
from scipy import stats

from femfit.identify.constants import POWER
from femfit.identify.decision.campaign import Campaign
from femfit.identify.refit.refit import Refit
from femfit.identify.refit.start import bounded_amplitudes
from femfit.identify.refit.unseen import left_out_groups


def detectable_magnitudes(campaign: Campaign, level: float) -> dict[str, dict[str, float]]:
    """The smallest magnitude of each effect's amplitudes that these settings and this noise show nine times in ten.

    The model's own misfit to its table counts as noise.

    Returns
    -------
    dict of str to dict of str to float
        Effect -> amplitude -> magnitude in its unit, each amplitude taken alone; infinite where the bounds end
        before. Nonlinear parameters have their usual values.
    """
    effects = {one.name for one in campaign.effects}
    threshold = stats.chi2.isf(level / max(len(effects), 1), 1)
    needed = (np.sqrt(threshold) + stats.norm.ppf(POWER)) ** 2  # of one degree of freedom; its other tail is nothing
    result: dict[str, dict[str, float]] = {}
    for one in campaign.effects:
        if one.name in result:
            continue
        result[one.name] = {}
        for k, p in enumerate(one.columns.amplitudes):
            length = float(np.linalg.norm(one.whitened[:, k]))
            magnitude = float(np.sqrt(needed)) / length if length > 0.0 else np.inf
            result[one.name][p.name] = magnitude if magnitude <= max(p.upper - p.null, p.null - p.lower) else np.inf
    return result


def explained_share(campaign: Campaign, fit: Refit, excess: float) -> float:
    """Part of the structured misfit that effects explain on runs left out, each in turn; on stretches of a single run.

    The effects were fitted to all runs; their amplitudes are fitted anew without each, to first order. 1 is all of the
    excess and 0 none of it; it is negative where the effects make the error on unseen runs larger.
    """
    target = campaign.whitened_residual
    moving = [j for j, (_, p) in enumerate(fit.free) if not p.nonlinear and not fit.active[j]]
    columns = fit.jacobian[:, moving]
    if not moving:
        return 0.0
    # To first order about the fit: what the readings are beside the part that no small change of the fit explains
    start = fit.whitened_residual + columns @ np.array([_to_null(fit, j) for j in moving])
    group = left_out_groups(campaign.observations)
    wide = np.array([[-np.inf], [np.inf]]) * np.ones(columns.shape[1])
    fall = 0.0
    for one in np.unique(group):
        out = group == one
        amplitude, _ = bounded_amplitudes(start[~out], -columns[~out], wide)
        unseen = start[out] + columns[out] @ amplitude
        fall += float(target[out] @ target[out] - unseen @ unseen)
    return fall / max(excess, 1e-12)


def _to_null(fit: Refit, j: int) -> float:
    """The step from a fitted amplitude to its null, over its plausible range."""
    k, p = fit.free[j]
    return (p.null - fit.effects[k].parameters[p.name]) / (p.plausible[1] - p.plausible[0])
