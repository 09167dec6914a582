"""Which change of the command moved a body, where a driver chops its voltage.

A chopped voltage changes back and forth, two times at least, between two levels that each last about as long as before.
Its changes are one command, given where the chopping begins, or where the higher level that it begins with does.
"""

from collections.abc import Sequence

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.open_loop.profile import Profile

SAME_LEVEL = 0.05
"""Conventional: part of a command's range within which two of its levels are the same; noise of a recorded voltage."""

AS_LONG = 2.0
"""Conventional: ratio up to which two stretches of a level last about as long; a driver's duty cycle wanders."""


def command_before(profiles: Sequence[Profile], time: float, after: float = 0.0) -> float:
    """The last change of a command up to a time in s, chopping taken as one.

    Parameters
    ----------
    after : float
        When the last motion ended: what was commanded before moved the body then.
    """
    return max((_before(profile, time, after) for profile in profiles), default=0.0)


def _before(profile: Profile, time: float, after: float) -> float:
    if profile.interpolation == "linear":
        return max((turn for turn in (0.0, *profile.turns_s.tolist()) if turn <= time), default=0.0)
    begins, levels, same = _stretches(profile.time_s, profile.value)
    last = max((k for k, begin in enumerate(begins) if begin <= time), default=0)
    lengths: list[float] = np.diff([*begins[: last + 1], time]).tolist()

    def alike(k: int) -> bool:
        return abs(levels[k] - levels[k - 2]) <= same

    def as_long(k: int) -> bool:
        return 1.0 / AS_LONG <= lengths[k] / lengths[k - 2] <= AS_LONG

    goes_on = last >= 3 and alike(last) and lengths[last] <= AS_LONG * lengths[last - 2]
    first = last
    for k in range(last - 1, 1, -1) if goes_on else ():
        if not (alike(k) and as_long(k)):
            if first < last and alike(k) and abs(levels[k - 2]) > abs(levels[k - 1]):
                first = k - 2  # the level that a current rises with before it is held by chopping
            break
        first = k - 2
    return min((begin for begin in begins[first : last + 1] if begin >= after), default=begins[last])


def _stretches(time: FloatArray, value: FloatArray) -> tuple[list[float], list[float], float]:
    """Where each level of a command that is held begins, the levels, and how near two are that count as one."""
    same = SAME_LEVEL * float(value.max() - value.min())
    begins, levels = [0.0], [float(value[0])]
    for moment, level in zip(time.tolist(), value.tolist(), strict=True):
        if abs(level - levels[-1]) > same:
            begins.append(moment)
            levels.append(level)
    return begins, levels, same
