"""What a campaign can show of each effect, and how far an effect lowers the error on runs that it was not fitted to.

References
----------
J. Cohen, Statistical Power Analysis for the Behavioral Sciences (Erlbaum, 1988), chapter 12: noncentral chi-square.
M. Stone, Journal of the Royal Statistical Society B 36 (1974) 111: cross-validation.
"""

from collections.abc import Callable

import numpy as np
from scipy import stats

from femfit.core.arrays import FloatArray
from femfit.identify.constants import OWN_MISFIT, POWER
from femfit.identify.decision.campaign import Campaign
from femfit.identify.noise.whitening import random_columns
from femfit.identify.refit.refit import Refit
from femfit.identify.refit.start import bounded_amplitudes
from femfit.identify.refit.unseen import left_out_groups


def detectable_magnitudes(campaign: Campaign, level: float) -> dict[str, dict[str, float]]:
    """The smallest magnitude of each effect's amplitudes that these settings and this noise show nine times in ten.

    Of a model that misses its own table, as the verdict tests it: what is no larger than the misfit that the verdict
    grants the model is not shown, however little noise there is.

    Returns
    -------
    dict of str to dict of str to float
        Effect -> amplitude -> magnitude in its unit, each amplitude taken alone; infinite where the bounds end
        before. Nonlinear parameters have their usual values.
    """
    effects = {one.name for one in campaign.effects}
    threshold = stats.chi2.isf(level / max(len(effects), 1), 1)
    needed = (np.sqrt(threshold) + stats.norm.ppf(POWER)) ** 2  # of one degree of freedom; its other tail is nothing
    granted = _beyond_own_misfit(campaign)
    result: dict[str, dict[str, float]] = {}
    for one in campaign.effects:
        if one.name in result:
            continue
        result[one.name] = {}
        for k, p in enumerate(one.columns.amplitudes):
            length = float(np.linalg.norm(one.whitened[:, k]))
            magnitude = float(np.sqrt(needed)) / length if length > 0.0 else np.inf
            if granted is not None and length > 0.0:
                magnitude = max(magnitude, granted(length, one.columns.columns[:, k]))
            result[one.name][p.name] = magnitude if magnitude <= max(p.upper - p.null, p.null - p.lower) else np.inf
    return result


def _beyond_own_misfit(campaign: Campaign) -> Callable[[float, FloatArray], float] | None:
    """The magnitude at which a column's misfit passes, nine times in ten, for more than the model's own; None for none.

    The verdict takes the longer of the misfit whitened and as recorded. The squared length s of a column c of length L,
    as recorded, has the mean s L^2 beyond noise and the variance V + 4 s S, with V that of the noise alone and S that
    of the noise along c; so that s solves (s L^2 - m)^2 = z^2 (V + 4 s S), where m is what is granted. The model's own
    misfit may oppose the column, by the part p of it that these readings show along c, at most all of it: then the
    length is p + sqrt(p^2 + s L^2).
    """
    observations, noise = campaign.observations, campaign.noise
    most = OWN_MISFIT * campaign.known_misfit
    if most <= 0.0:
        return None
    z, sigma = float(stats.norm.ppf(POWER)), noise.sigma[observations.channel]
    columns, deviations = random_columns(observations, noise.mount_m, noise.run)
    random = columns / sigma[:, None] * deviations
    slow = ((1.0 + noise.rho) / (1.0 - noise.rho))[observations.channel]
    variance = 2.0 * float(np.sum(slow) + np.sum(random**2, axis=0) @ np.sum(random**2, axis=0))

    def magnitude(whitened_length: float, column: FloatArray) -> float:
        c = column / sigma
        square, along = float(c @ c), float(slow @ c**2 + np.sum((random.T @ c) ** 2))
        # Of (square s - most)^2 = z^2 (variance + 4 s along); written out, since the two squares of most cancel
        root = np.sqrt(z**2 * (4.0 * along * (most * square + z**2 * along) + square**2 * variance))
        alone = (most * square + 2.0 * z**2 * along + root) / square
        opposed = min(abs(float(c @ (observations.residual / sigma))) / square, np.sqrt(campaign.known_misfit / square))
        recorded = opposed + np.sqrt(opposed**2 + alone / square)
        return float(min(opposed + (np.sqrt(most + 1.0) + z) / whitened_length, recorded))

    return magnitude


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
