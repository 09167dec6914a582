"""The error that effects leave on runs that they were not fitted to.

Each run is left out in turn and the effects are fitted to the others, without any linearisation. Where a body was put
back and by what a run is offset as a whole no model can know, so these are predicted from the left-out run itself
before its error is counted: what remains is compared with the scatter of a single reading.

References
----------
M. Stone, Journal of the Royal Statistical Society B 36 (1974) 111: cross-validation.
G. K. Robinson, Statistical Science 6 (1991) 15: best linear unbiased prediction of random effects.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.patterns import own_misfit_columns
from femfit.identify.noise.whitening import NoiseModel, Whitening, chains_of, random_columns
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.refit import refit
from femfit.identify.refit.start import Start


@dataclass(frozen=True, eq=False)
class UnseenError:
    """Error on runs left out, all of them in turn; on quarters of a single run."""

    rms: Mapping[str, float]  # Root mean square of recorded minus predicted per channel
    rms_beside_random: Mapping[str, float]  # The same with each run's own re-mount and offset predicted from that run
    chi2: float  # Weighted sum of squares over all noise, re-mounts and offsets
    # What was fitted without each group, by its number, as the rows are grouped
    effects: Mapping[int, tuple[AddedEffect, ...]]


def unseen_error(
    observations: Observations,
    noise: NoiseModel,
    start: Sequence[Start],
    fixed: Mapping[str, Mapping[str, float]] | None = None,
    prior_sd: Mapping[str, float] | None = None,
    prior_mean: Mapping[str, float] | None = None,
) -> UnseenError:
    """Cross-validate effects over the runs of a campaign."""
    group = left_out_groups(observations)
    beside, as_read = np.zeros(len(group)), np.zeros(len(group))
    chi2, effects = 0.0, {}
    for one in np.unique(group):
        out = group == one
        seen, unseen = observations.select(~out), observations.select(out)
        fit = refit(
            seen,
            Whitening(seen, noise, chains_of(seen), own_misfit_columns(seen)),
            start,
            fixed=fixed,
            prior_sd=prior_sd,
            prior_mean=prior_mean,
        )
        effects[int(one)] = fit.effects
        residual = unseen.value - unseen.predict(fit.effects)
        whitening = Whitening(unseen, noise, chains_of(unseen))
        as_read[out], beside[out] = residual, beside_random(residual, whitening)
        white = whitening.full(residual)
        chi2 += float(white @ white)
    return UnseenError(channel_rms(observations, as_read), channel_rms(observations, beside), chi2, effects)


def left_out_groups(observations: Observations) -> IntArray:
    """The run of each reading, shape (M,); with a single run, four stretches of it."""
    run = observations.column("run").astype(int)
    if len(np.unique(run)) > 1:
        return run
    order: FloatArray = observations.column("order")
    return np.asarray(np.searchsorted(np.quantile(order, [0.25, 0.5, 0.75]), order))


def beside_random(residual: FloatArray, whitening: Whitening) -> FloatArray:
    """A residual, shape (M,), without the best linear unbiased prediction of its re-mounts and runs."""
    columns, deviations = random_columns(whitening.observations, whitening.noise.mount_m, whitening.noise.run)
    columns = columns * deviations
    white = whitening.serial(columns)
    size = np.linalg.solve(white.T @ white + np.eye(white.shape[1]), white.T @ whitening.serial(residual))
    return np.asarray(residual - columns @ size)


def channel_rms(observations: Observations, residual: FloatArray) -> dict[str, float]:
    """Root mean square of a residual, shape (M,), per channel."""
    return {name: float(np.sqrt(np.mean(residual[observations.of(name)] ** 2))) for name in observations.channels}
