"""Dry friction that a model does not know, from what a filter has to correct of the velocity.

A force that the model lacks makes the filter correct the velocity by the same amount at every sample in the mean:
m <v - v predicted> / h. Of dry friction that is F_c where the body approaches and -F_c where it goes away, so that the
mean of -m (v - v predicted) sign(v) / h over samples of a velocity clear of its deviation is F_c.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.amount import amount
from femfit.replay.constants import COVARIANCE_BLOCK, FOLLOWS, FORGOTTEN, LEAST_BLOCKS, MOVING, SHOWN
from femfit.replay.prepare import Prepared
from femfit.replay.run_filter import Replayed


@dataclass(frozen=True)
class DryFriction:
    """A force against the velocity, and its standard deviation."""

    force_N: float
    deviation_N: float

    def __str__(self) -> str:
        return f"{amount(self.force_N, 'N')} against the velocity, +-{amount(1.96 * self.deviation_N, 'N')} (95 %)"


def dry_friction(prepared: Prepared, replayed: Replayed) -> DryFriction | None:
    """The friction where it is clear of its scatter and acts both ways; None elsewhere.

    Nothing is said of a filter whose innovations are far larger than it says: it lags behind the motion, and a model
    that is wrong along the distance would look like friction.
    """
    square = np.nanmean(replayed.innovation**2 / replayed.variance)
    if not square < FOLLOWS:
        return None
    velocity, deviation = replayed.mean[:, 1], replayed.deviation[:, 1]
    mass, step = prepared.model.require_motion().mass_kg, prepared.model.sample_time_s
    force = mass * (velocity - replayed.predicted[:, 1]) / step
    with np.errstate(invalid="ignore"):
        moves = (np.abs(velocity) > MOVING * deviation) & np.isfinite(force) & ~prepared.log.held
    for begin in prepared.log.begins:  # where the first estimate is still being corrected
        moves[begin : begin + FORGOTTEN] = False
    near, far = prepared.model.require_motion().ends
    moves &= (replayed.mean[:, 0] > near) & (replayed.mean[:, 0] < far)
    each = []
    for sign in (-1.0, 1.0):
        here = moves & (np.sign(velocity) == sign)
        blocks = int(here.sum()) // COVARIANCE_BLOCK
        if blocks < LEAST_BLOCKS:
            return None
        means = np.array([block.mean() for block in np.array_split(force[here], blocks)])
        each.append((float(means.mean()), float(means.var(ddof=1) / blocks)))
    (approaching, first), (leaving, second) = each
    friction, spread = 0.5 * (approaching - leaving), 0.5 * float(np.sqrt(first + second))
    return DryFriction(friction, spread) if friction > SHOWN * spread else None
