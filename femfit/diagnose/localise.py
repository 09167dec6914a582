"""Where a model fails: the channel with the most structure over its noise, and what the structure changes with."""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.diagnose.diagnosis import Where
from femfit.diagnose.naming import Evidence

_LEAST_SHARE = 0.1
"""Part of a channel's structured excess that a covariate must carry to be reported."""


def localise(evidence: Evidence) -> Where:
    """Find the channel and the covariates of a structured misfit.

    Parameters
    ----------
    evidence : Evidence
        Of the readings.

    Returns
    -------
    Where
        Covariates whose patterns carry at least a tenth of the excess, the strongest first; none where the misfit is
        the same everywhere.
    """
    rest, whitening, patterns = evidence.rest, evidence.whitening, evidence.patterns.patterns
    columns = whitening.full(patterns.columns)
    strength: list[float] = []
    count: list[int] = []
    for c in range(len(evidence.observations.channels)):
        strength.append(_excess(columns[:, patterns.channel == c], rest))
        count.append(int(np.count_nonzero(evidence.observations.channel == c)))
    worst = int(np.argmax(np.array(strength) / np.maximum(count, 1)))
    here = patterns.channel == worst
    covariates = _covariates(columns[:, here], [patterns.along[k] for k in np.flatnonzero(here)], rest, strength[worst])
    channel = evidence.observations.channels[worst]
    size = float(np.sqrt(max(strength[worst], 0.0) / max(count[worst], 1)))
    changing = f", changing with {' and '.join(covariates)}" if covariates else ", by the same amount everywhere"
    return Where(channel, covariates, f"{channel} is off by {size:.2g} times its noise floor{changing}.")


def _covariates(columns: FloatArray, along: list[frozenset[str]], rest: FloatArray, excess: float) -> tuple[str, ...]:
    losses = {}
    for name in sorted(set().union(*along)):
        without = np.array([name not in names for names in along])
        losses[name] = excess - _excess(columns[:, without], rest)
    strong = [name for name in losses if losses[name] > _LEAST_SHARE * excess]
    return tuple(sorted(strong, key=lambda name: -losses[name]))


def _excess(columns: FloatArray, rest: FloatArray) -> float:
    """Squared length of the residual along whitened columns, less what noise gives."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0.0] / size[size > 0.0]
    if not columns.shape[1]:
        return 0.0
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    left = left[:, sizes > 1e-6 * sizes[0]]
    along = left.T @ rest
    return float(along @ along - left.shape[1])
