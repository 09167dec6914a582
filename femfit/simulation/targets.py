"""Where a loop holds its body: distances given or derived, which driver and sensors must reach.

Reference steps that the driver can follow.

A step of the wanted distance passes three equal first-order filters,

    r''' = w^3 (target - r) - 3 w^2 r' - 3 w r'',

which give r, r' and r'' that belong together. w is the largest for which the voltage that is needed,

    u = R i + L i' - k_m r',    F(r, i) = F_0(r) - c r' - m r'',

of each circuit uses at most a part of the way from the holding voltage to the clamp: the rest is left to the feedback.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.device.electrics import PositionSensor
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import command_limits, voltage_limits
from femfit.model.dynamics import voltages_needed
from femfit.model.hall import HallSensor
from femfit.model.sensors import HALL, predict_sensor, reading_of, sensor_named
from femfit.simulation.allocation import (
    covered_currents,
    current_ranges,
    currents_for_acceleration,
    currents_for_force,
    force_range,
)
from femfit.simulation.constants import FOLLOWED_PART, REFERENCE_PART, USABLE_PART, USED_AUTHORITY
from femfit.simulation.operating_point import operating_point, usable_coil_pole, zero_order_hold


def covered(model: ActuatorModel) -> ActuatorModel:
    """The model with current amplifiers whose commands it covers; voltages are kept in by the controllers."""
    circuits = []
    for circuit, (least_A, most_A) in zip(model.circuits, covered_currents(model).T.tolist(), strict=True):
        low, high = command_limits(circuit)
        drive = replace(circuit.drive, current_min_A=max(low, least_A), current_max_A=min(high, most_A))
        circuits.append(replace(circuit, drive=drive) if circuit.drive.kind == "current" else circuit)
    return replace(model, circuits=tuple(circuits))


def derived_targets(model: ActuatorModel, sensors: Sequence[str]) -> tuple[float, ...]:
    """Steps over the middle 40 % of the distances at which the driver holds the body and the sensors see it."""
    motion, d = model.require_motion(), np.linspace(*model.travel_m, 301)
    needed, (weakest, strongest) = motion.static_force(d), force_range(model, d)
    holdable = d[(weakest <= needed) & (strongest >= needed)]
    if holdable.size < 3:
        low, high = 1e3 * needed.min(), 1e3 * needed.max()
        asked = (
            f"the weight is {low:.4g} mN"
            if low == high
            else f"weight, springs and load ask for {low:.4g}..{high:.4g} mN"
        )
        spans = ", ".join(f"{least:.3g}..{most:.3g} A" for least, most in current_ranges(model))
        raise DomainError(
            f"Model {model.name!r} cannot hold its body of {1e3 * motion.mass_kg:g} g anywhere in {1e3 * d[0]:g}.."
            f"{1e3 * d[-1]:g} mm: {asked}, and with {spans} the force is {1e3 * weakest.min():.4g}.."
            f"{1e3 * strongest.max():.4g} mN. It is not an actuator that levitates this body; change mass or supply to "
            "simulate one that is."
        )
    currents = currents_for_force(model, holdable, motion.static_force(holdable))
    blind = [_at_an_end(model, name, holdable, currents)[0] for name in sensors]
    sensed = holdable[~np.any(blind, axis=0)]
    if sensed.size < 3:
        require_sensed(model, sensors, holdable, currents)
    near, far = float(sensed[0]), float(sensed[-1])
    return near + 0.3 * (far - near), near + 0.7 * (far - near), near + 0.3 * (far - near)


def _at_an_end(
    model: ActuatorModel, name: str, distance: FloatArray, currents: FloatArray
) -> tuple[BoolArray, FloatArray]:
    """At which points of rest a Hall element or position sensor gives the end of its range, and what it would read."""
    sensor, reading, states = sensor_named(model, name), reading_of(model, name), np.zeros((len(distance), model.order))
    if not isinstance(sensor, HallSensor | PositionSensor):
        return np.zeros(len(distance), dtype=np.bool_), distance
    states[:, 0], states[:, 2 : 2 + currents.shape[1]] = distance, currents
    values = predict_sensor(model, sensor, states)
    return (values <= reading.low) | (values >= reading.high), values


def require_sensed(model: ActuatorModel, sensors: Sequence[str], distance: FloatArray, currents: FloatArray) -> None:
    """Refuse points of rest at which a sensor of the distance is at the end of its range."""
    for name in sensors:
        blind, values = _at_an_end(model, name, distance, currents)
        if not np.any(blind):
            continue
        reading, k = reading_of(model, name), int(np.argmax(blind))
        remedy = "a smaller sensitivity_V_per_T" if name == HALL else "a wider range"
        raise DomainError(
            f"The sensor {name} of model {model.name!r} must stay within its range of {reading.low:g}.."
            f"{reading.high:g} {reading.unit} where the body is held; at {1e3 * distance[k]:.4g} mm it would read "
            f"{values[k]:.4g} {reading.unit}. Give it {remedy}, or choose other reference distances."
        )


@dataclass(frozen=True, eq=False)
class Reference:
    """The reference at one sample, or at all of them."""

    # In m, m/s and m/s^2; shape (runs,) or scalar at one sample, (steps,) or (steps, runs) for all
    distance: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    currents: FloatArray  # That hold a body which moves so, A; one more axis of n

    def at(self, k: int | slice | IntArray) -> "Reference":
        """The reference at sample k, or of some runs at one sample."""
        return Reference(self.distance[k], self.velocity[k], self.acceleration[k], self.currents[k])


def reference_steps(
    targets: Sequence[float], steps: int, sample_time: float, rate: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance in m, velocity and acceleration, (steps,), of equally long stays at each target, the first from rest.

    Steps between them go through filters of ``rate`` rad/s.
    """
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-(rate**3), -3.0 * rate**2, -3.0 * rate]])
    phi, gamma = zero_order_hold(A, np.array([0.0, 0.0, rate**3]), sample_time)
    target = np.asarray(targets)[np.arange(steps) * len(targets) // steps]
    states = np.empty((steps, 3))
    state = np.array([targets[0], 0.0, 0.0])
    for k in range(steps):
        states[k] = state
        state = phi @ state + gamma * target[k]
    return states[:, 0], states[:, 1], states[:, 2]


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
    # The second half: the step and ten time constants
    r, v, a = (values[500:] for values in reference_steps((pair[0], pair[1]), 1000, step, rate))
    needed = _voltages(model, r, v, a, step)
    resting = _voltages(model, r, np.zeros_like(v), np.zeros_like(a), np.inf)
    # Of what can be held: beyond it a voltage may be used while the current changes, and is left to the feedback
    ends = np.clip(covered_currents(model), *model.validity.current_limits_A[: len(model.circuits)].T)
    held = voltages_needed(model, r[:2], np.zeros(2), ends)[0]
    limits = voltage_limits(model.circuits)
    low, high = np.maximum(limits[0], held[0]), np.minimum(limits[1], held[1])
    lower = resting - USED_AUTHORITY * (resting - low)
    upper = resting + USED_AUTHORITY * (high - resting)
    return bool(np.all((needed >= lower) & (needed <= upper)))


def _voltages(model: ActuatorModel, r: FloatArray, v: FloatArray, a: FloatArray, step: float) -> FloatArray:
    """Across each winding, of shape (N, n)."""
    currents = currents_for_acceleration(model, r, a, v)
    volts, inductance = voltages_needed(model, r, v, currents)
    return volts + np.einsum("rjk,rk->rj", inductance, np.gradient(currents, axis=0) / step)
