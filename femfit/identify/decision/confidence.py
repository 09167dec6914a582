"""How far a name can be trusted: whether an effect that nobody has listed would bear it too.

Whether a campaign distinguishes an effect from one outside the catalogue cannot be tested with the catalogue's own
effects as rivals. They serve as examples of what physics does to these readings: had one of them been the cause, as
large as what was found, and not been listed, would the test after naming have noticed? What adds the same to every
reading of a channel has more causes than any list holds, so that a constant error of each channel is always among the
examples.

References
----------
J. Cohen, Statistical Power Analysis for the Behavioral Sciences (Erlbaum, 1988), chapter 12: noncentral chi-square.
"""

from collections.abc import Sequence

import numpy as np
from scipy import optimize, stats

from femfit.core.arrays import FloatArray
from femfit.core.ties import ROUNDING, ranked
from femfit.identify.constants import LEVEL_AFTER, POWER, TIE
from femfit.identify.decision.campaign import Campaign
from femfit.identify.decision.candidate import Candidate
from femfit.identify.noise.whitening import orthonormal_basis
from femfit.tables.measurement import CHANNEL_WORDS


def look_alikes(
    campaign: Campaign, chosen: Candidate, classes: Sequence[tuple[str, ...]], rivals: Sequence[Candidate]
) -> tuple[str, ...]:
    """Effects that would have been given the chosen name on these data, had they been the cause and not been listed.

    First the others of the classes; then rivals that pass the test and fit as well, if with more parameters; then the
    most alike first: an effect, or a constant error of a channel, whose contribution, as long as what was found, has
    less beside the fitted one than the lack-of-fit test notices nine times in ten.
    """
    observations = campaign.observations
    signal = campaign.whitening.full(observations.predict(chosen.fit.effects) - observations.base)
    fitted = orthonormal_basis(chosen.fit.jacobian[:, ~chosen.fit.active])
    beside: dict[str, float] = {}
    for one in campaign.effects:
        if one.name not in chosen.fit.names:
            beside[one.name] = min(beside.get(one.name, 1.0), _squared_sine(one.whitened, fitted))
    for name in observations.channels:
        constant = observations.of(name).astype(np.float64)[:, None]
        words = f"a constant error of the {CHANNEL_WORDS.get(name, name)}"
        beside[words] = _squared_sine(campaign.whitening.full(constant), fitted)
    unseen = _noticed(campaign) / max(float(signal @ signal), 1e-12)
    others = [name for members in classes for name in members[1:]]
    as_good = equally_good(campaign, chosen, rivals)
    others += [name for one in as_good for name in one.fit.names if name not in chosen.fit.names]
    alike = ranked([name for name, sine in beside.items() if sine < unseen], lambda name: -beside[name], ROUNDING)
    return tuple(dict.fromkeys(others + alike))


def equally_good(campaign: Campaign, chosen: Candidate, rivals: Sequence[Candidate]) -> list[Candidate]:
    """Rivals of as many effects that pass the test and fit as well, whatever their parameters cost."""
    slack, count = TIE * campaign.expected_variance, len(chosen.fit.names)
    rivals = [one for one in rivals if len(one.fit.names) == count and one.passes()]
    return [one for one in rivals if one.fit.chi2 <= chosen.fit.chi2 + slack]


def _squared_sine(columns: FloatArray, fitted: FloatArray) -> float:
    """Squared sine of the smallest angle between a column and the space of orthonormal ones."""
    length = np.sum(columns**2, axis=0)
    seen = length > 0.0
    along = np.sum((fitted.T @ columns[:, seen]) ** 2, axis=0)
    return float(np.min(1.0 - along / length[seen], initial=1.0))


def _noticed(campaign: Campaign) -> float:
    """Squared length of a broad misfit, in whitened units, that the lack-of-fit test notices nine times in ten."""
    groups = campaign.patterns.groups
    count = groups[0].basis.shape[1]
    threshold = stats.chi2.isf(LEVEL_AFTER / len(groups), count)
    return float(optimize.brentq(lambda c: stats.ncx2.sf(threshold, count, c) - POWER, 1e-3, 1e4))
