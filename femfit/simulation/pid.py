"""The linear position controller: proportional, integral and derivative of the distance error."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import commands_currents
from femfit.simulation.controllers import Controller, reference_currents
from femfit.simulation.limits import limited
from femfit.simulation.operating_point import resting_command
from femfit.simulation.reference import Reference

_ROUNDED = 1e-13
"""Derived: sum of three numerators over their sizes, below which it is their rounding and no integral."""


@dataclass(frozen=True, eq=False)
class Pid(Controller):
    """The structure of (35), tuned on the model.

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
    filter_pole: float
    # b_0, b_1, b_2 in V/m (A/m for an amplifier), negative in sum: a body that is too far away needs more force
    gains: tuple[float, float, float]
    direction: tuple[float, ...] = (1.0,)
    current_gain_ohm: float = 0.0
    words = 4  # w(k-1), w(k-2), e(k-1), e(k-2)

    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """The recursion, clamped."""
        w1, w2, e1, e2 = memory.T
        b0, b1, b2 = self.gains
        along = np.asarray(self.direction)
        needed = resting_command(self.model, reference_currents(self.model, reference))
        error = reference.distance - estimate[:, 0]
        w = (1.0 + self.filter_pole) * w1 - self.filter_pole * w2 + b0 * error + b1 * e1 + b2 * e2
        # As gains on the voltage R i: none behind an amplifier, which closes the loop of the current itself
        inner = np.where(commands_currents(self.model), 0.0, self.current_gain_ohm / self.model.resistances_ohm)
        back = inner * self.model.resistances_ohm * estimate[:, 2:]
        command = limited(self.model, estimate, (1.0 + inner) * (needed + along * w[:, None]) - back)
        effective = ((command + back) / (1.0 + inner) - needed) @ along / (along @ along)
        return command, np.stack([effective, w1, error, e1], axis=1)

    @property
    def parts(self) -> dict[str, float]:
        """Gains as an engineer gives them, for the error d - r: per m, m s and m/s, the filter in rad/s, K_i in ohm.

        C(z) = k_p + k_i t z/(z - 1) + k_d (1 - p)/t (z - 1)/(z - p), with p = exp(-filter t).
        """
        step, p = self.model.sample_time_s, self.filter_pole
        b0, b1, b2 = (-gain for gain in self.gains)
        total = b0 + b1 + b2
        integral = total / (1.0 - p) if abs(total) > _ROUNDED * (abs(b0) + abs(b1) + abs(b2)) else 0.0
        proportional = (b0 - b2 - integral) / (1.0 - p)
        derivative = (b2 - proportional * p) * step / (1.0 - p)
        rate = -np.log(p) / step if p > 0.0 else np.inf
        return {
            "kp": proportional,
            "ki": integral / step,
            "kd": derivative,
            "filter_rad_s": float(rate),
            "current": self.current_gain_ohm,
        }


def pid_of_parts(
    model: ActuatorModel,
    kp: float,
    ki: float,
    kd: float,
    filter_rad_s: float,
    current: float = 0.0,
    direction: tuple[float, ...] = (1.0,),
) -> Pid:
    """The controller whose :attr:`Pid.parts` these are."""
    step = model.sample_time_s
    p = float(np.exp(-filter_rad_s * step))
    each, rate = ki * step, kd * (1.0 - p) / step
    gains = (kp + each + rate, -kp * (1.0 + p) - each * p - 2.0 * rate, kp * p + rate)
    return Pid(model, p, (-gains[0], -gains[1], -gains[2]), direction, current)
