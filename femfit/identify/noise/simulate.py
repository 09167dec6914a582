"""Noise drawn from a campaign's noise model."""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.identify.noise.whitening import Whitening, random_columns, sequence, setting_errors


def simulated_noise(whitening: Whitening, generator: np.random.Generator) -> FloatArray:
    """Draw everything in the readings that is neither model nor effect, shape (M,), in their units.

    It is AR(1) noise along each run, re-mounts, run offsets, and what errors of the settings make.
    """
    observations, noise, chains = whitening.observations, whitening.noise, whitening.chains
    rho = noise.rho[observations.channel] ** chains.gap
    fresh = generator.standard_normal(len(rho))
    value = np.empty_like(fresh)
    for k in np.lexsort((sequence(observations), observations.column("run"), observations.channel)):
        value[k] = (
            fresh[k] if chains.first[k] else rho[k] * value[chains.before[k]] + np.sqrt(1 - rho[k] ** 2) * fresh[k]
        )
    columns, deviations = random_columns(observations, noise.mount_m, noise.run)
    random = columns @ (deviations * generator.standard_normal(len(deviations)))
    value = value * noise.sigma[observations.channel] + random
    for number, size in setting_errors(observations, noise.stop_m):
        value += size * generator.standard_normal(number.max() + 1)[number]
    return np.asarray(value)
