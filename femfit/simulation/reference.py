"""Reference steps that the driver can follow.

A step of the wanted distance passes three equal first-order filters,

    r''' = w^3 (target - r) - 3 w^2 r' - 3 w r'',

which give r, r' and r'' that belong together. w is the largest for which the voltage that is needed,

    u = R i + L i' - k_m r',    F(r, i) = F_0(r) - c r' - m r'',

uses at most a part of the way from the holding voltage to the clamp, so that the rest is left to the feedback.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.constants import USED_AUTHORITY
from femfit.simulation.operating_point import (
    current_for_acceleration,
    operating_point,
    usable_coil_pole,
    zero_order_hold,
)


@dataclass(frozen=True, eq=False)
class Reference:
    """The reference at one sample, or at all of them."""

    # In m, m/s and m/s^2; shape (runs,) or scalar at one sample, (steps,) or (steps, runs) for all
    distance: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    # Current that holds a body which moves so, A, of the same shape; worked out by the controller where None
    current: FloatArray | None = None

    def at(self, k: int | IntArray) -> "Reference":
        """The reference at sample k, or of some runs at one sample."""
        current = None if self.current is None else self.current[k]
        return Reference(self.distance[k], self.velocity[k], self.acceleration[k], current)


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
    if all(r.current is not None for r in references):
        names.append("current")
    parts = (np.stack([getattr(r, name) for r in references], axis=1) for name in names)
    return Reference(*(np.repeat(part, counts, axis=1) for part in parts))


def reference_rate(model: ActuatorModel, targets: Sequence[float]) -> float:
    """The largest w in rad/s that leaves the feedback its part of the voltage, at most a third of the coil's pole."""
    highest = usable_coil_pole(operating_point(model, targets[0]), model.sample_time_s) / 3.0
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
    circuit = model.require_circuit()
    step = 0.02 / rate
    path = reference_steps((pair[0], pair[1]), 1000, step, rate)
    moving = slice(500, 1000)  # the second half: the step and ten time constants
    r, v, a = path.distance[moving], path.velocity[moving], path.acceleration[moving]
    needed = _voltage(model, r, v, a, step)
    resting = _voltage(model, r, np.zeros_like(v), np.zeros_like(a), np.inf)
    lower = resting - USED_AUTHORITY * (resting - circuit.voltage_min_V)
    upper = resting + USED_AUTHORITY * (circuit.voltage_max_V - resting)
    return bool(np.all((needed >= lower) & (needed <= upper)))


def _voltage(model: ActuatorModel, r: FloatArray, v: FloatArray, a: FloatArray, step: float) -> FloatArray:
    circuit = model.require_circuit()
    current = current_for_acceleration(model, r, a, v)
    magnetic = model.magnetics.state(r, current)
    rate = np.gradient(current) / step
    voltage = circuit.resistance_ohm * current + magnetic.inductance * rate - magnetic.motional_constant * v
    return np.asarray(voltage)
