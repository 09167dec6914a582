"""Controllers: pure steps from an estimate and a reference to a voltage."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from femfit.core.errors import DomainError
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.constants import DERIVATIVE_FILTER_RATIO
from femfit.simulation.operating_point import OperatingPoint, current_for_acceleration, usable_coil_pole
from femfit.simulation.reference import Reference


class Controller(ABC):
    """A controller; frozen, its memory of shape (runs, words) is passed in and out."""

    words: int = 0

    @abstractmethod
    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """The voltage of the next sample period in V, within the driver's clamp, and the memory for the next sample.

        Parameters
        ----------
        memory : array, shape (runs, words)
            From the sample before; zeros at the first.
        estimate : array, shape (runs, 3)
            Distance in m, velocity in m/s, current in A.
        """


@dataclass(frozen=True, eq=False)
class SplitController(Controller):
    """Different controllers for different runs of one batch."""

    parts: tuple[tuple[IntArray, Controller], ...]  # Indices of the runs and their controller; every run once

    @property
    def words(self) -> int:  # type: ignore[override]
        """Those of the part that has the most."""
        return max(controller.words for _, controller in self.parts)

    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """Each part's command on its own runs."""
        voltage, updated = np.empty(len(estimate)), memory.copy()
        for rows, controller in self.parts:
            part = reference if np.ndim(reference.distance) == 0 else reference.at(rows)
            voltage[rows], words = controller.command(memory[rows, : controller.words], estimate[rows], part)
            updated[rows, : controller.words] = words
        return voltage, updated


@dataclass(frozen=True, eq=False)
class Backstepping(Controller):
    """The nonlinear controller, (34) with its sign, gravity, 1/m and coil lag put right.

    Two steps back, from the distance error e = d - r over the velocity to the force:

        a = r'' - k_v (v - r') - k_p (d - r),      F(d, i*) = F_0(d) - c v - m a,      U = R i* + K_i (i* - i),

    the second equation inverted on the model. The back-EMF is left to act: it adds to k_v.

    References
    ----------
    A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eq. (34).
    P. Kokotovic, IEEE Control Systems Magazine 12 (1992) 7: backstepping.
    """

    model: ActuatorModel
    position_gain: float
    velocity_gain: float
    current_gain_ohm: float = 0.0

    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """The class's equations, clamped."""
        circuit, box = self.model.require_circuit(), self.model.validity
        # An estimate outside of the model would be answered by an extrapolated force
        distance = np.clip(estimate[:, 0], box.distance_min_m, box.distance_max_m)
        velocity, current = estimate[:, 1], estimate[:, 2]
        acceleration = (
            reference.acceleration
            - self.velocity_gain * (velocity - reference.velocity)
            - self.position_gain * (estimate[:, 0] - reference.distance)
        )
        wanted = current_for_acceleration(self.model, distance, acceleration, velocity, near=current)
        voltage = circuit.resistance_ohm * wanted + self.current_gain_ohm * (wanted - current)
        return np.clip(voltage, circuit.voltage_min_V, circuit.voltage_max_V), memory


def design_backstepping(model: ActuatorModel, points: Sequence[OperatingPoint]) -> Backstepping:
    """Gains from the model's poles, for the fastest unstable pole lambda and the slowest coil among the points.

    The current follows i* with the pole p = (R + K_i)/L. Linearised, with lambda^2 = -F_d/m,

        s^3/p + s^2 + (k_v - lambda^2/p) s + k_p = 0,

    so a velocity gain below (lambda^2 + k_p)/p leaves the loop unstable. The poles sum up to -p; the slowest of them
    is fastest as the triple pole w = p/3: k_p = w^2/3, k_v = w + lambda^2/(3 w). K_i = 0 (the paper's form, p = R/L) is
    kept as long as w is faster than lambda; otherwise K_i raises p to 3 lambda. A coil that is faster than the samples
    is taken as slow as they can follow.
    """
    unstable = max(point.unstable_pole_rad_s for point in points)
    slowest = min(points, key=lambda point: point.coil_pole_rad_s)
    current_pole = max(usable_coil_pole(slowest, model.sample_time_s), 3.0 * unstable)
    triple = current_pole / 3.0
    return Backstepping(
        model=model,
        position_gain=triple**2 / 3.0,
        velocity_gain=triple + unstable**2 / (3.0 * triple),
        current_gain_ohm=max(current_pole - slowest.coil_pole_rad_s, 0.0) * slowest.inductance_H,
    )


@dataclass(frozen=True, eq=False)
class Pid(Controller):
    """The linear controller: the structure of (35), re-tuned on the model.

        w(k) = (1 + p) w(k-1) - p w(k-2) + b_0 e(k) + b_1 e(k-1) + b_2 e(k-2),   u = clamp(w + u_r),   e = r - d,

    an integrator (z = 1), a derivative filter (z = p) and a numerator. What the recursion remembers is the clamped
    voltage less u_r, which stops windup. u_r is the voltage that the reference itself needs, R i with
    F(r, i) = F_0(r) - c r' - m r''; without it, as in (35), the integrator alone would find it and lag behind by
    millimetres.

    References
    ----------
    A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eq. (35).
    """

    model: ActuatorModel
    filter_pole: float
    # b_0, b_1, b_2, negative in sum: a body that is too far away needs more voltage
    gains_V_m: tuple[float, float, float]
    words = 4  # w(k-1), w(k-2), e(k-1), e(k-2)

    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """The recursion, clamped."""
        circuit = self.model.require_circuit()
        w1, w2, e1, e2 = memory.T
        b0, b1, b2 = self.gains_V_m
        current = reference.current
        if current is None:
            r, a = np.atleast_1d(reference.distance), np.atleast_1d(reference.acceleration)
            current = current_for_acceleration(self.model, r, a, reference.velocity)
        needed = circuit.resistance_ohm * current
        error = reference.distance - estimate[:, 0]
        w = (1.0 + self.filter_pole) * w1 - self.filter_pole * w2 + b0 * error + b1 * e1 + b2 * e2
        voltage = np.clip(w + needed, circuit.voltage_min_V, circuit.voltage_max_V)
        return voltage, np.stack([voltage - needed, w1, error, e1], axis=1)


def design_pid(model: ActuatorModel, point: OperatingPoint) -> Pid:
    """Gains by pole placement at one operating point.

    With the plant's G = c/A held over a sample (orders 2 and 3) the closed loop is

        A(z) (z - 1)(z - p) + c(z) (b_0 z^2 + b_1 z + b_2) = (z - q)^4 (z - q_5).

    Its coefficients are linear in p, b_0, b_1, b_2 and q_5: for a wanted quadruple pole q = exp(-w t_s) they follow
    from one 5 x 5 system. In continuous time, with the coil's pole p_c and the derivative filter's N, equal powers of s
    give 10 w^2 - 4 (p_c + N) w + N p_c - lambda^2 = 0, and a choice of N picks w.

    References
    ----------
    K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (Prentice Hall, 1997), chapter 5.
    """
    step = model.sample_time_s
    coil, unstable = usable_coil_pole(point, step), point.unstable_pole_rad_s
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
