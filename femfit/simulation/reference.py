"""Reference steps that the driver can follow.

A step of the wanted distance passes three equal first-order filters,

    r''' = w^3 (target - r) - 3 w^2 r' - 3 w r'',

which give r, r' and r'' that belong together. w is the largest for which the voltage that is needed,

    u = R i + L i' - k_m r',    F(r, i) = F_0(r) - c r' - m r'',

of each circuit uses at most a part of the way from the holding voltage to the clamp: the rest is left to the feedback.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import circuit_terms, voltage_limits
from femfit.simulation.allocation import currents_for_acceleration
from femfit.simulation.constants import FOLLOWED_PART, REFERENCE_PART, USABLE_PART, USED_AUTHORITY
from femfit.simulation.limits import covered_currents
from femfit.simulation.operating_point import operating_point, usable_coil_pole, zero_order_hold


@dataclass(frozen=True, eq=False)
class Reference:
    """The reference at one sample, or at all of them."""

    # In m, m/s and m/s^2; shape (runs,) or scalar at one sample, (steps,) or (steps, runs) for all
    distance: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    # Currents that hold a body which moves so, A, one more axis of n; worked out by the controller where None
    currents: FloatArray | None = None

    def at(self, k: int | slice | IntArray) -> "Reference":
        """The reference at sample k, or of some runs at one sample."""
        currents = None if self.currents is None else self.currents[k]
        return Reference(self.distance[k], self.velocity[k], self.acceleration[k], currents)


def reference_steps(targets: Sequence[float], steps: int, sample_time: float, rate: float) -> Reference:
    """Equally long stays at each target in m, the first from rest, through filters of ``rate`` rad/s."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-(rate**3), -3.0 * rate**2, -3.0 * rate]])
    phi, gamma = zero_order_hold(A, np.array([0.0, 0.0, rate**3]), sample_time)
    target = np.asarray(targets)[np.arange(steps) * len(targets) // steps]
    states = np.empty((steps, 3))
    state = np.array([targets[0], 0.0, 0.0])
    for k in range(steps):
        states[k] = state
        state = phi @ state + gamma * target[k]
    return Reference(states[:, 0], states[:, 1], states[:, 2])


def stack_references(references: Sequence[Reference], counts: Sequence[int]) -> Reference:
    """Different references of shape (steps,) for consecutive runs of one batch, as one of shape (steps, runs)."""
    names = ["distance", "velocity", "acceleration"]
    if all(r.currents is not None for r in references):
        names.append("currents")
    parts = (np.stack([getattr(r, name) for r in references], axis=1) for name in names)
    return Reference(*(np.repeat(path, counts, axis=1) for path in parts))


def reference_rate(model: ActuatorModel, targets: Sequence[float]) -> float:
    """The largest w in rad/s that leaves the feedback its part of the voltage.

    At most a third of the coil's pole, or a tenth of the body's own rate where the coil is slower than that, and not
    much faster than the body itself, where it has a rate of its own.
    """
    point = operating_point(model, targets[0])
    highest = usable_coil_pole(model, point) / 3.0
    if point.natural_rad_s:
        followed = min(FOLLOWED_PART * point.natural_rad_s, USABLE_PART / 3.0 / model.sample_time_s)
        highest = min(max(highest, followed), REFERENCE_PART * point.natural_rad_s)
    pairs = {pair for pair in pairwise(targets) if pair[0] != pair[1]}
    low, high = 1e-3 * highest, highest
    if all(_fits(model, pair, high) for pair in pairs):
        return high
    for _ in range(20):
        middle = float(np.sqrt(low * high))
        if all(_fits(model, pair, middle) for pair in pairs):
            low = middle
        else:
            high = middle
    return low


def _fits(model: ActuatorModel, pair: tuple[float, float], rate: float) -> bool:
    step = 0.02 / rate
    path = reference_steps((pair[0], pair[1]), 1000, step, rate)
    moving = slice(500, 1000)  # the second half: the step and ten time constants
    r, v, a = path.distance[moving], path.velocity[moving], path.acceleration[moving]
    needed = _voltages(model, r, v, a, step)
    resting = _voltages(model, r, np.zeros_like(v), np.zeros_like(a), np.inf)
    # Of what can be held: beyond it a voltage may be used while the current changes, and is left to the feedback
    held = model.resistances_ohm * covered_currents(model)
    limits = voltage_limits(model.circuits)
    low, high = np.maximum(limits[0], held[0]), np.minimum(limits[1], held[1])
    lower = resting - USED_AUTHORITY * (resting - low)
    upper = resting + USED_AUTHORITY * (high - resting)
    return bool(np.all((needed >= lower) & (needed <= upper)))


def _voltages(model: ActuatorModel, r: FloatArray, v: FloatArray, a: FloatArray, step: float) -> FloatArray:
    """Across each winding, of shape (N, n)."""
    currents = currents_for_acceleration(model, r, a, v)
    _, motional, inductance = circuit_terms(model, r, currents)
    rate = np.gradient(currents, axis=0) / step
    volts = model.resistances_ohm * currents + np.einsum("rjk,rk->rj", inductance, rate) - motional * v[:, None]
    return np.asarray(volts)
