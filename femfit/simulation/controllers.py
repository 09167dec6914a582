"""Controllers: pure steps from an estimate and a reference to the commands of the drivers.

A nonlinear one, and linear ones of the distance's error and of every state.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import commands_currents
from femfit.simulation.allocation import currents_for_acceleration, limited
from femfit.simulation.operating_point import resting_command
from femfit.simulation.targets import Reference

ControllerName = Literal["backstepping", "pid", "state-feedback"]


class Controller(ABC):
    """A controller; frozen, its memory of shape (runs, words) is passed in and out."""

    name: ClassVar[ControllerName]
    words: int = 0

    @property
    @abstractmethod
    def parts(self) -> dict[str, float]:
        """Gains by the names that an engineer gives them, positive where they bring the body back."""

    @abstractmethod
    def with_parts(self, changed: Mapping[str, float]) -> "Controller":
        """The controller in which some of the :attr:`parts` are changed."""

    @abstractmethod
    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """The commands of the next sample period, and the memory for the next sample.

        Parameters
        ----------
        memory : array, shape (runs, words)
            From the sample before; zeros at the first.
        estimate : array, shape (runs, 2 + n)
            Distance in m, velocity in m/s, currents in A.

        Returns
        -------
        command : array, shape (runs, n)
            In V, or in A for a current amplifier, within the driver's limits.
        memory : array, shape (runs, words)
        """


@dataclass(frozen=True, eq=False)
class Backstepping(Controller):
    """The nonlinear controller, (34) with its sign, gravity, 1/m and coil lag put right.

    Two steps back, from the distance error e = d - r over the velocity to the force:

        a = r'' - k_v (v - r') - k_p (d - r),      F(d, i*) = F_0(d) - c v - m a,      U = R i* + K_i (i* - i),

    the second equation inverted on the model, for several circuits with the least copper loss about their bias. The
    back-EMF is left to act: it adds to k_v. A current amplifier is commanded i*.

    References
    ----------
    A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eq. (34).
    P. Kokotovic, IEEE Control Systems Magazine 12 (1992) 7: backstepping.
    """

    data = "position_gain_1_s2=position", "velocity_gain_1_s=velocity", "current_gain_ohm=current"

    model: ActuatorModel
    position: float  # k_p in 1/s^2
    velocity: float  # k_v in 1/s
    current: float = 0.0  # K_i in ohm
    name = "backstepping"

    @property
    def parts(self) -> dict[str, float]:
        """The outer gains, and that of the current where a voltage is commanded."""
        outer = {"position": self.position, "velocity": self.velocity}
        return outer if commands_currents(self.model).all() else {**outer, "current": self.current}

    def with_parts(self, changed: Mapping[str, float]) -> "Backstepping":
        """By their names."""
        return replace(self, **changed)  # type: ignore[arg-type]  # all of them are numbers

    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """The class's equations, clamped."""
        model, box = self.model, self.model.validity
        # An estimate outside of the model would be answered by an extrapolated force
        distance = np.clip(estimate[:, 0], box.distance_min_m, box.distance_max_m)
        velocity, currents = estimate[:, 1], estimate[:, 2:]
        acceleration = (
            reference.acceleration
            - self.velocity * (velocity - reference.velocity)
            - self.position * (estimate[:, 0] - reference.distance)
        )
        wanted = currents_for_acceleration(model, distance, acceleration, velocity, near=currents)
        volts = resting_command(model, wanted) + self.current * (wanted - currents)
        command = np.where(commands_currents(model), wanted, volts)
        return limited(model, estimate, command), memory


@dataclass(frozen=True, eq=False)
class Pid(Controller):
    """The structure of (35), tuned on the model.

        C(z) = k_p + k_i t z/(z - 1) + k_d (1 - p)/t (z - 1)/(z - p),   w = -C(z) e,
        w(k) = (1 + p) w(k-1) - p w(k-2) + b_0 e(k) + b_1 e(k-1) + b_2 e(k-2),   u* = u_r + g w,   e = r - d,
        U = clamp(u* + K_i (u*/R - i)),

    an integrator (z = 1), a derivative filter (z = p) and a numerator. g is the change of the commands that raises the
    force with the least copper loss: 1 for one circuit that attracts, +1 and -1 for two that pull against each other.
    K_i closes an inner loop of the current round a coil that is slow beside the body; elsewhere it is zero, and U = u*.
    What the recursion remembers is the u* of the clamped command less u_r, which stops windup. u_r is the command that
    the reference itself needs, R i with F(r, i) = F_0(r) - c r' - m r''; without it, as in (35), the integrator alone
    would find it and lag behind by millimetres.

    References
    ----------
    A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eq. (35).
    """

    model: ActuatorModel
    kp: float  # Per m; of a body that is too far away and needs more force they are positive
    ki: float  # Per m s
    kd: float  # Per m/s
    filter_pole: float  # p
    direction: tuple[float, ...] = (1.0,)
    current: float = 0.0  # K_i in ohm
    words = 4  # w(k-1), w(k-2), e(k-1), e(k-2)
    name = "pid"

    @property
    def gains(self) -> tuple[float, float, float]:
        """b_0, b_1 and b_2 in V/m, or A/m for an amplifier, negative in sum."""
        step, p = self.model.sample_time_s, self.filter_pole
        each, rate = self.ki * step, self.kd * (1.0 - p) / step
        return -self.kp - each - rate, self.kp * (1.0 + p) + each * p + 2.0 * rate, -self.kp * p - rate

    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """The recursion, clamped."""
        w1, w2, e1, e2 = memory.T
        b0, b1, b2 = self.gains
        along = np.asarray(self.direction)
        needed = resting_command(self.model, np.atleast_2d(reference.currents))
        error = reference.distance - estimate[:, 0]
        w = (1.0 + self.filter_pole) * w1 - self.filter_pole * w2 + b0 * error + b1 * e1 + b2 * e2
        # As gains on the voltage R i: none behind an amplifier, which closes the loop of the current itself
        inner = np.where(commands_currents(self.model), 0.0, self.current / self.model.resistances_ohm)
        back = inner * self.model.resistances_ohm * estimate[:, 2:]
        command = limited(self.model, estimate, (1.0 + inner) * (needed + along * w[:, None]) - back)
        effective = ((command + back) / (1.0 + inner) - needed) @ along / (along @ along)
        return command, np.stack([effective, w1, error, e1], axis=1)

    @property
    def parts(self) -> dict[str, float]:
        """Gains as an engineer gives them; the derivative's filter in rad/s, p = exp(-filter t)."""
        rate = -np.log(self.filter_pole) / self.model.sample_time_s if self.filter_pole > 0.0 else np.inf
        outer = {"kp": self.kp, "ki": self.ki, "kd": self.kd}
        return {**outer, "filter_rad_s": float(rate), "current": self.current}

    @property
    def data(self) -> dict[str, Any]:
        """What programs read."""
        return {**self.parts, "filter_pole": self.filter_pole, "gains": self.gains}

    def with_parts(self, changed: Mapping[str, float]) -> "Pid":
        """By their names."""
        fields = dict(changed)
        if "filter_rad_s" in fields:
            fields["filter_pole"] = float(np.exp(-fields.pop("filter_rad_s") * self.model.sample_time_s))
        return replace(self, **fields)  # type: ignore[arg-type]  # all of them are numbers


@dataclass(frozen=True, eq=False)
class StateFeedback(Controller):
    """Feedback of every state, with an integral.

        u = u_r + K_x (x_r - x^) + K_p (pending commands) - K_i q,      q(k+1) = q(k) + t (d - r)

    References
    ----------
    K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (Prentice Hall, 1997), section 4.5.
    """

    data = "gains", "integral"

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
        gains, names = (
            np.column_stack([self.gains, self.integral]),
            ["distance", "velocity", *self._currents, "integral"],
        )
        for name, value in changed.items():
            k = names.index(name)
            if name in self._currents:
                gains[k - 2, k] = value
            else:
                gains[:, k] = -value * self.direction
        return replace(self, gains=gains[:, :-1], integral=gains[:, -1])

    @property
    def _currents(self) -> list[str]:
        names = self.model.circuit_names
        return ["current"] if len(names) == 1 else [f"current_{name}" for name in names]
