"""How far a name can be trusted: whether an effect that nobody has listed would bear it too.

Whether a campaign tells an effect from one outside the catalogue cannot be tested with the catalogue's own effects as
rivals. They serve as examples of what physics does to these readings: had one of them been the cause, as large as what
was found, and not been listed, would the gate after naming have noticed? What adds the same to every reading of a
channel has more causes than any list holds, so that a constant error of each channel is always among the examples.

References
----------
J. Cohen, Statistical Power Analysis for the Behavioral Sciences (Erlbaum, 1988), chapter 12: noncentral chi-square.
"""

from collections.abc import Sequence

import numpy as np
from scipy import optimize, stats

from femfit.core.arrays import FloatArray
from femfit.identify.decision.evidence import Evidence
from femfit.identify.noise.whitening import orthonormal_basis
from femfit.identify.readings.amounts import CHANNEL_WORDS
from femfit.identify.signatures.candidate import Candidate

_POWER = 0.9


def look_alikes(
    evidence: Evidence, chosen: Candidate, classes: Sequence[tuple[str, ...]], level: float
) -> tuple[str, ...]:
    """Effects that would have been given the chosen name on these data, had they been the cause and not been listed.

    Parameters
    ----------
    classes : sequence of tuple of str
        What these data cannot tell from each of its effects, itself first.

    Returns
    -------
    tuple of str
        The rest of the classes, then the most alike first: an effect of any shape constants, or a constant error of a
        channel, whose trace of the found length has less beside the fitted one than the gate notices nine times in ten.
    """
    observations = evidence.observations
    found = evidence.whitening.full(observations.predict(chosen.fit.effects) - observations.base)
    fitted = orthonormal_basis(chosen.fit.jacobian[:, ~chosen.fit.active])
    beside: dict[str, float] = {}
    for one, white in evidence.columns:
        name = one.effect.name
        if name not in chosen.fit.names:
            beside[name] = min(beside.get(name, 1.0), _squared_sine(white, fitted))
    for name in observations.channels:
        constant = observations.of(name).astype(np.float64)[:, None]
        words = f"a constant error of the {CHANNEL_WORDS.get(name, name)}"
        beside[words] = _squared_sine(evidence.whitening.full(constant), fitted)
    unseen = _noticed(evidence, level) / max(float(found @ found), 1e-12)
    refitted = [name for members in classes for name in members[1:]]
    alike = sorted((name for name, sine in beside.items() if sine < unseen), key=beside.__getitem__)
    return tuple(dict.fromkeys(refitted + alike))


def _squared_sine(columns: FloatArray, fitted: FloatArray) -> float:
    """Of the smallest angle between a column and the space of orthonormal ones."""
    length = np.sum(columns**2, axis=0)
    seen = length > 0.0
    along = np.sum((fitted.T @ columns[:, seen]) ** 2, axis=0)
    return float(np.min(1.0 - along / length[seen], initial=1.0))


def _noticed(evidence: Evidence, level: float) -> float:
    """Squared length of a broad misfit, in whitened units, that the gate notices nine times in ten."""
    groups = evidence.patterns.groups
    count = groups[0].basis.shape[1]
    threshold = stats.chi2.isf(level / len(groups), count)
    return float(optimize.brentq(lambda c: stats.ncx2.sf(threshold, count, c) - _POWER, 1e-3, 1e4))
