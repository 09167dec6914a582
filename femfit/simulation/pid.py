"""The linear controller: the structure of (35), re-tuned on the model.

    w(k) = (1 + p) w(k-1) - p w(k-2) + b_0 e(k) + b_1 e(k-1) + b_2 e(k-2),       u = clamp(w + u_r),   e = r - d,

an integrator (z = 1), a derivative filter (z = p) and a numerator; the printed 1.604 and -0.603 are p = 0.6035. What
the recursion remembers is the clamped voltage less u_r: that is (35)'s f_1, f_2, and it stops windup.

u_r is the voltage that the reference itself needs, R i with F(r, i) = m (g - r''). (35) has none (u_r = 0):
its integrator alone must find the 0.86 .. 2.15 V between 22 and 30 mm, and on the way lags by some lambda^2 p_c r'/w^4,
3 mm at the speed that the clamp allows, where a linear loop has no meaning.

With the plant's G = c/A held over a sample (orders 2 and 3) the closed loop is

    A(z) (z - 1)(z - p) + c(z) (b_0 z^2 + b_1 z + b_2) = (z - q)^4 (z - q_5).

Its coefficients are linear in p, b_0, b_1, b_2 and q_5: for a wanted quadruple pole q = exp(-w t_s) they follow from
one 5 x 5 system. In continuous time, with the coil's pole p_c and the derivative filter's N, equal powers of s give

    10 w^2 - 4 (p_c + N) w + N p_c - lambda^2 = 0,

and a choice of N picks w. The printed 0.6035 means N = 6.1 p_c on the paper's coil. N = 3 p_c lowers w by a tenth and
the voltage's noise by 40 %: at 30 mm the clamp then cuts it too rarely to lose the body; with N = 6 p_c it does.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eq. (35).
K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (Prentice Hall, 1997), chapter 5: polynomial pole placement.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.constants import DERIVATIVE_FILTER_RATIO
from femfit.simulation.controller import Controller, Reference
from femfit.simulation.operating_point import OperatingPoint, current_for_acceleration, usable_coil_pole


@dataclass(frozen=True, eq=False)
class Pid(Controller):
    """The PID controller in its recursive form.

    Parameters
    ----------
    gains_V_m : (float, float, float)
        b_0, b_1, b_2, negative in sum: a body that is too far away needs more voltage.
    """

    model: ActuatorModel
    filter_pole: float
    gains_V_m: tuple[float, float, float]

    def initial_memory(self, estimate: FloatArray) -> FloatArray:
        """w(k-1), w(k-2), e(k-1), e(k-2), all zero at rest on the reference."""
        return np.zeros((len(estimate), 4))

    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """The recursion, clamped."""
        circuit = self.model.require_circuit()
        w1, w2, e1, e2 = memory[:, :4].T
        b0, b1, b2 = self.gains_V_m
        current = reference.current
        if current is None:
            r, a = np.atleast_1d(reference.distance), np.atleast_1d(reference.acceleration)
            current = current_for_acceleration(self.model, r, a)
        needed = circuit.resistance_ohm * current
        error = reference.distance - estimate[:, 0]
        w = (1.0 + self.filter_pole) * w1 - self.filter_pole * w2 + b0 * error + b1 * e1 + b2 * e2
        voltage = np.clip(w + needed, circuit.voltage_min_V, circuit.voltage_max_V)
        return voltage, np.stack([voltage - needed, w1, error, e1], axis=1)


def design_pid(model: ActuatorModel, point: OperatingPoint) -> Pid:
    """Gains by pole placement at one operating point."""
    step = model.sample_time_s
    coil, unstable = usable_coil_pole(point, step), point.mechanical_pole_rad_s
    derivative = DERIVATIVE_FILTER_RATIO * coil
    half = 4.0 * (coil + derivative)
    w = (half - np.sqrt(half**2 - 40.0 * (derivative * coil - unstable**2))) / 20.0
    if w <= 0.0:
        raise DomainError(
            f"A PID controller needs a coil that is faster than the body; at {1e3 * point.distance_m:g} mm R/L is "
            f"{coil:.4g} rad/s, the body's unstable pole {unstable:.4g} rad/s. Use backstepping, which feeds back the "
            "current, or a coil with less inductance."
        )
    phi, gamma = point.discrete(step)
    a = np.poly(phi).real
    c = np.poly(phi - np.outer(gamma, [1.0, 0.0, 0.0])).real - a  # c(z) of distance/voltage, order 2
    integrated = np.polymul(a, [1.0, -1.0])
    wanted = np.poly(np.full(4, np.exp(-w * step)))
    columns = np.zeros((5, 5))
    columns[:, 0] = -integrated
    for power in range(3):
        shifted = np.polymul(c[1:], np.eye(3)[power])
        columns[5 - len(shifted) :, 1 + power] = shifted
    columns[:, 4] = wanted
    right = np.polymul(wanted, [1.0, 0.0])[1:] - np.polymul(integrated, [1.0, 0.0])[1:]
    p, b0, b1, b2, _ = np.linalg.solve(columns, right)
    return Pid(model=model, filter_pole=float(p), gains_V_m=(float(b0), float(b1), float(b2)))
