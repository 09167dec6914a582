"""Feedback of every state, with an integral: the linear-quadratic regulator.

    u = u_r + K_x (x_r - x^) + K_p (pending commands) - K_i q,      q(k+1) = q(k) + t (d - r)

K is designed on the sampled linear model with the commands that are still on their way as states. The regulator weighs
the distance and its integral against the commands; for a wanted bandwidth w the weights are those that put the poles of
the ideal chain from command to distance on a circle of that radius (Butterworth's pattern).

The search by patterns for gains.

References
----------
K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (Prentice Hall, 1997), sections 4.5 (integral) and
11.1 (linear-quadratic regulator).
R. Hooke and T. A. Jeeves, J. ACM 8 (1961) 212.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import commands_currents
from femfit.simulation.allocation import limited, limits_of
from femfit.simulation.constants import FIRST_FACTOR, LAST_FACTOR
from femfit.simulation.controllers import Controller
from femfit.simulation.linear_loop import LinearPlant
from femfit.simulation.operating_point import OperatingPoint, feedback_gain, resting_command
from femfit.simulation.targets import Reference

INTEGRAL_PART = 0.25
"""Conventional: rate at which the integral acts over the bandwidth; at a quarter it costs some 15 degrees of phase."""


@dataclass(frozen=True, eq=False)
class StateFeedback(Controller):
    """The class of the module's head."""

    model: ActuatorModel
    gains: FloatArray  # K_x, shape (n, 2 + n)
    integral: FloatArray  # K_i, shape (n,)
    pending: FloatArray  # Of the commands on their way, the last one first; shape (n, latency n)
    direction: FloatArray  # Change of the commands that raises the force, as in :class:`OperatingPoint`; shape (n,)
    name = "state-feedback"

    @property
    def words(self) -> int:  # type: ignore[override]
        """The integral, and the commands on their way."""
        return 1 + int(self.pending.shape[1])

    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """The law, clamped; the integral stands while the clamp holds back what it asks for."""
        q, pending = memory[:, 0], memory[:, 1:]
        currents = np.atleast_2d(reference.currents)
        needed = resting_command(self.model, currents)
        error = estimate[:, 0] - reference.distance
        moving = np.empty_like(estimate)
        moving[:, 0], moving[:, 1] = error, estimate[:, 1] - reference.velocity
        moving[:, 2:] = estimate[:, 2:] - currents
        wanted = needed - moving @ self.gains.T - pending @ self.pending.T - q[:, None] * self.integral
        command = limited(self.model, estimate, wanted)
        held_back = np.any((command - wanted) * (self.integral * error[:, None]) > 0.0, axis=1)
        grown = np.where(held_back, q, q + self.model.sample_time_s * error)
        later = np.concatenate([command - needed, pending], axis=1)[:, : self.pending.shape[1]]
        return command, np.concatenate([grown[:, None], later], axis=1)

    @property
    def parts(self) -> dict[str, float]:
        """Of distance, velocity and integral that of the direction's largest entry; each current has its own."""
        first = int(np.argmax(np.abs(self.direction)))
        along = -float(self.direction[first])
        return {
            "distance": float(self.gains[first, 0]) / along,
            "velocity": float(self.gains[first, 1]) / along,
            **{name: float(self.gains[k, 2 + k]) for k, name in enumerate(self._currents)},
            "integral": float(self.integral[first]) / along,
        }

    def with_parts(self, changed: Mapping[str, float]) -> "StateFeedback":
        """Those of distance, velocity and integral for all commands, along the direction."""
        gains, integral = self.gains.copy(), self.integral
        for name, value in changed.items():
            if name == "integral":
                integral = -value * self.direction
            elif name in self._currents:
                k = self._currents.index(name)
                gains[k, 2 + k] = value
            else:
                gains[:, ("distance", "velocity").index(name)] = -value * self.direction
        return replace(self, gains=gains, integral=integral)

    @property
    def _currents(self) -> list[str]:
        names = self.model.circuit_names
        return ["current"] if len(names) == 1 else [f"current_{name}" for name in names]


def augmented(
    model: ActuatorModel, point: OperatingPoint, plant: LinearPlant, latency: int
) -> tuple[FloatArray, FloatArray]:
    """Plant, commands on their way and integral: x+ = A x + B u over (x, u(k-1) .. u(k-latency), q)."""
    n = len(point.commands)
    order = 2 + n  # states of effects follow the currents and are not fed back
    size = order + n * latency + 1
    x, pending, integral, command = np.split(np.eye(size + n), [order, size - 1, size])
    commands = np.concatenate([command, pending])
    moved = plant.A[:order, :order] @ x + plant.B[:order] @ commands[n * latency :]
    both = np.concatenate([moved, commands[: n * latency], integral + model.sample_time_s * x[:1]])
    return both[:, :size], both[:, size:]


def regulator(
    model: ActuatorModel, point: OperatingPoint, plant: LinearPlant, bandwidth_rad_s: float, latency: int = 0
) -> StateFeedback:
    """The linear-quadratic regulator of a bandwidth."""
    A, B = augmented(model, point, plant, latency)
    low, high = limits_of(model)
    span = np.where(np.isfinite(high - low), high - low, 1.0)
    # Distance per command far above all poles: k_m / (m L s^3) behind a voltage, k_m / (m s^2) behind an amplifier
    per_current = point.A[1, 2:]
    amplified = commands_currents(model)
    per_command = np.where(amplified, per_current, per_current @ point.B[2:])
    relative = 2.0 if amplified.all() else 3.0
    reach = float(np.sqrt(np.sum((per_command * span) ** 2)))
    weight = (bandwidth_rad_s**relative / reach) ** 2
    Q = np.zeros_like(A)
    Q[0, 0] = weight
    Q[-1, -1] = weight * (INTEGRAL_PART * bandwidth_rad_s) ** 2
    gain = feedback_gain(A, B, Q, np.diag(1.0 / span**2))
    order = 2 + len(point.commands)
    pending = gain[:, order : order + len(point.commands) * latency]
    return StateFeedback(model, gain[:, :order], gain[:, -1], pending, point.direction)


def pattern_search(
    score: Callable[[FloatArray], float], start: FloatArray, highest: FloatArray, enough: float
) -> FloatArray:
    """Climb by one coordinate after the other, and along what the last round changed, with steps that shrink."""
    values, best, step = start, score(start), np.log(FIRST_FACTOR)
    while step > np.log(LAST_FACTOR) and best < enough:
        before = values
        for k in range(len(values)):
            for sign in (1.0, -1.0):
                tried = values.copy()
                tried[k] = min(tried[k] + sign * step, highest[k])
                if (reached := score(tried)) > best + 1e-9:
                    values, best = tried, reached
                    break
        if np.array_equal(values, before):
            step *= 0.5
            continue
        tried = np.minimum(2.0 * values - before, highest)
        if (reached := score(tried)) > best:
            values, best = tried, reached
    return values
