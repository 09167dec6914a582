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

from femfit.core.arrays import FloatArray
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.magnitude import left_out_groups
from femfit.identify.noise.whitening import NoiseModel, Whitening, chains_of, random_columns
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.refit import Start, refit


@dataclass(frozen=True, eq=False)
class UnseenError:
    """Error on runs left out, all of them in turn.

    Parameters
    ----------
    rms : mapping of str to float
        Per channel, beside each run's own re-mount and offset.
    rms_as_read : mapping of str to float
        The same with the re-mount and the offset in it.
    chi2 : float
        Weighted sum of squares over all noise, re-mounts and offsets.
    """

    rms: Mapping[str, float]
    rms_as_read: Mapping[str, float]
    chi2: float


def unseen_error(
    observations: Observations,
    noise: NoiseModel,
    start: Sequence[Start],
    prior_sd: Mapping[str, float] | None = None,
    otherwise: tuple[AddedEffect, ...] = (),
) -> UnseenError:
    """Cross-validate effects over the runs of a campaign.

    Parameters
    ----------
    start : sequence of (EffectColumns, array of shape (k,))
        Effects with amplitudes to start from; none for nothing to fit.
    prior_sd : mapping of str to float, or None
        As in :func:`femfit.identify.refit.refit.refit`.
    otherwise : tuple of AddedEffect
        What holds where there is nothing to fit.

    Returns
    -------
    UnseenError
        With a single run, over four stretches of it.
    """
    group = left_out_groups(observations)
    beside, as_read = np.zeros(len(group)), np.zeros(len(group))
    chi2 = 0.0
    for one in np.unique(group):
        out = group == one
        seen, unseen = observations.select(~out), observations.select(out)
        effects = otherwise
        if start:
            effects = refit(seen, Whitening(seen, noise, chains_of(seen)), start, prior_sd=prior_sd).effects
        residual = unseen.value - unseen.predict(effects)
        whitening = Whitening(unseen, noise, chains_of(unseen))
        as_read[out], beside[out] = residual, beside_random(residual, whitening)
        white = whitening.full(residual)
        chi2 += float(white @ white)
    return UnseenError(channel_rms(observations, beside), channel_rms(observations, as_read), chi2)


def beside_random(residual: FloatArray, whitening: Whitening) -> FloatArray:
    """A residual without its re-mounts' and runs' best linear unbiased prediction.

    Parameters
    ----------
    residual : array, shape (M,)
        In the readings' units.

    Returns
    -------
    array, shape (M,)
        In the readings' units.
    """
    columns, deviations = random_columns(whitening.observations, whitening.noise.mount_m, whitening.noise.run)
    columns = columns * deviations
    white = whitening.serial(columns)
    size = np.linalg.solve(white.T @ white + np.eye(white.shape[1]), white.T @ whitening.serial(residual))
    return np.asarray(residual - columns @ size)


def channel_rms(observations: Observations, residual: FloatArray) -> dict[str, float]:
    """Root mean square per channel.

    Parameters
    ----------
    residual : array, shape (M,)
        In the readings' units.
    """
    return {name: float(np.sqrt(np.mean(residual[observations.of(name)] ** 2))) for name in observations.channels}


def floor_as_read(observations: Observations, noise: NoiseModel) -> dict[str, float]:
    """What even a perfect model would leave on a new run, re-mount and offset included."""
    sigma, run = noise.sigma[observations.channel], noise.run[observations.channel]
    expected = np.sqrt(sigma**2 + run**2 + (noise.mount_m * observations.distance_slope) ** 2)
    return channel_rms(observations, expected)
