"""How a body that reaches no stop answers one step of the command: rise, overshoot, settling."""

from dataclasses import dataclass

import numpy as np

from femfit.core.amount import amount
from femfit.core.arrays import FloatArray

BAND = 0.02
"""Conventional: settled is what stays within this part of the whole change."""

LAST = 0.1
"""Conventional: part of the time at whose beginning the motion must have settled for its end to be known."""


@dataclass(frozen=True)
class StepResponse:
    """From one place of rest to another.

    Parameters
    ----------
    start_m, end_m : float
        Distances at rest.
    rise_s : float
        From 10 to 90 % of the change, at their first passing.
    overshoot : float
        Largest excess over the change, as a part of it; 0 where there is none.
    settling_s : float
        After which the distance stays within 2 % of the change.
    """

    start_m: float
    end_m: float
    rise_s: float
    overshoot: float
    settling_s: float

    def __str__(self) -> str:
        over = f"overshoot {100.0 * self.overshoot:.2g} %" if self.overshoot > 0.0 else "no overshoot"
        return (
            f"The body moves from {amount(self.start_m, 'm', 3)} to {amount(self.end_m, 'm', 3)}: "
            f"{amount(self.rise_s, 's', 3)} from 10 to 90 % of the way, {over}, "
            f"within 2 % after {amount(self.settling_s, 's', 3)}."
        )


def step_response(time: FloatArray, distance: FloatArray) -> StepResponse | None:
    """Of a motion that begins at rest at time 0; None where it does not move, or has not settled at its end."""
    change = float(distance[-1] - distance[0])
    if change == 0.0:
        return None
    way = (distance - distance[0]) / change
    outside = np.flatnonzero(np.abs(way - 1.0) > BAND)
    settled = outside[-1] + 1
    if time[settled] > (1.0 - LAST) * time[-1]:
        return None
    # Linear between the samples on either side of a level
    first, last = (float(np.interp(0.0, *_crossing(time, way, level))) for level in (0.1, 0.9))
    excess = float(way.max() - 1.0)
    overshoot = excess if excess > 1e-6 else 0.0
    return StepResponse(float(distance[0]), float(distance[-1]), last - first, overshoot, float(time[settled]))


def _crossing(time: FloatArray, way: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
    after = int(np.argmax(way >= level))
    pair = slice(after - 1, after + 1)
    return way[pair] - level, time[pair]
