"""States of effects (lag, hysteresis) along a recorded motion.

Every state's rate is affine in that state alone, z' = a - b z with a and b given by the motion, so that over a step of
constant a and b it moves exactly to z exp(-b h) + a (1 - exp(-b h)) / b, however fast it decays.

References
----------
G. E. Blelloch, IEEE Transactions on Computers 38 (1989) 1526: linear recurrences as prefix sums.
"""

from dataclasses import replace

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect

_SLOWEST = 1e-12
"""Decay over a step below which a state only adds up."""


def states_along(
    added: AddedEffect,
    time: FloatArray,
    distance: FloatArray,
    current: FloatArray,
    motional_constant: FloatArray,
    at: Conditions,
    first: BoolArray,
) -> dict[str, FloatArray]:
    """The states of one effect at every node, at rest where a stretch begins.

    Parameters
    ----------
    time, distance, current : array, shape (n,)
        At the nodes, in s, m and A.
    motional_constant : array, shape (n,)
        k_m in V s/m.
    first : array of bool, shape (n,)
        Whether a new stretch begins.

    Returns
    -------
    dict of str to array, each of shape (n,)
        Empty for an effect without states, or whose parameters need none.
    """
    memory = added.memory
    if memory is None:
        return {}
    fresh, step = first[1:], np.diff(time)
    moves = ~fresh & (step > 0.0)  # neighbouring windows share a node
    velocity, rate = (np.divide(np.diff(x), step, out=np.zeros_like(step), where=moves) for x in (distance, current))
    d, i, constant = (0.5 * (x[1:] + x[:-1]) for x in (distance, current, motional_constant))
    moving = replace(
        at,
        branch=np.sign(rate),
        velocity_m_s=velocity,
        current_rate_A_s=rate,
        motional_V=constant * velocity,
        coil_temperature_C=_between(at.coil_temperature_C),
        magnet_temperature_C=_between(at.magnet_temperature_C),
        time_s=_between(at.time_s),
        elapsed=_between(at.elapsed),
    )
    at_zero, at_one = (
        memory.rate({name: np.full_like(d, z) for name in memory.names}, d, velocity, i, rate, moving, added.parameters)
        for z in (0.0, 1.0)
    )
    result = {}
    for name in memory.names:
        decay = np.maximum((at_zero[name] - at_one[name]) * np.where(moves, step, 0.0), _SLOWEST)
        kept = np.where(fresh, 0.0, np.exp(-decay))
        gained = np.where(moves, at_zero[name] * step * -np.expm1(-decay) / decay, 0.0)
        result[name] = _recurrence(np.append(0.0, kept), np.append(0.0, gained))
    return result


def _between(condition: FloatArray | float) -> FloatArray | float:
    """A condition on the steps between nodes."""
    values = np.asarray(condition)
    return 0.5 * (values[1:] + values[:-1]) if values.ndim else condition


def _recurrence(kept: FloatArray, gained: FloatArray) -> FloatArray:
    """x_k = kept_k x_(k-1) + gained_k from x_(-1) = 0, by doubling."""
    factor, total, span = kept.copy(), gained.copy(), 1
    while span < len(total):
        total[span:] = total[span:] + factor[span:] * total[:-span]
        factor[span:] = factor[span:] * factor[:-span]
        span *= 2
    return total
