"""The nonlinear controller, (34) with its sign, gravity, 1/m and coil lag put right.

Two steps back, from the distance error e = d - r over the velocity to the force:

    a = r'' - k_v (v - r') - k_p (d - r),      F(d, i*) = m (g - a),      U = R i* + K_i (i* - i),

the second equation inverted on the model. For F1e its solution is i* = (d^2/m_b)(m (g - a) - a_4 d^-4): the paper's
596.11e3 d (...) with d^2 for d. The back-EMF k_m v is left to act: it adds k_m^2/(m R) to k_v, 0.5 to 62 on the rig.

The current follows i* with the pole p = (R + K_i)/L. Linearised, with lambda^2 = -F_d/m,

    s^3/p + s^2 + (k_v - lambda^2/p) s + k_p = 0,

so a velocity gain below (lambda^2 + k_p)/p leaves the loop unstable. The poles sum up to -p; the slowest of them is
fastest as the triple pole w = p/3: k_p = w^2/3, k_v = w + lambda^2/(3 w). Without current feedback p = R/L. K_i = 0
(the paper's form) is kept as long as w is faster than lambda; otherwise K_i raises p to 3 lambda. A coil that is
faster than the samples is taken as slow as they can follow.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eq. (34).
P. Kokotovic, IEEE Control Systems Magazine 12 (1992) 7: backstepping.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.controller import Controller, Reference
from femfit.simulation.operating_point import OperatingPoint, current_for_acceleration, usable_coil_pole


@dataclass(frozen=True, eq=False)
class Backstepping(Controller):
    """The backstepping controller."""

    model: ActuatorModel
    position_gain: float
    velocity_gain: float
    current_gain_ohm: float = 0.0

    def initial_memory(self, estimate: FloatArray) -> FloatArray:
        """None: the controller has no memory."""
        return np.empty((len(estimate), 0))

    def command(self, memory: FloatArray, estimate: FloatArray, reference: Reference) -> tuple[FloatArray, FloatArray]:
        """The module's equations, clamped."""
        circuit, box = self.model.require_circuit(), self.model.validity
        # An estimate outside of the model would be answered by an extrapolated force
        distance = np.clip(estimate[:, 0], box.distance_min_m, box.distance_max_m)
        velocity, current = estimate[:, 1], estimate[:, 2]
        acceleration = (
            reference.acceleration
            - self.velocity_gain * (velocity - reference.velocity)
            - self.position_gain * (estimate[:, 0] - reference.distance)
        )
        wanted = current_for_acceleration(self.model, distance, acceleration, near=current)
        voltage = circuit.resistance_ohm * wanted + self.current_gain_ohm * (wanted - current)
        return np.clip(voltage, circuit.voltage_min_V, circuit.voltage_max_V), memory


def design_backstepping(model: ActuatorModel, points: Sequence[OperatingPoint]) -> Backstepping:
    """Gains from the model's poles, for the fastest unstable pole and the slowest coil among the points."""
    unstable = max(point.mechanical_pole_rad_s for point in points)
    slowest = min(points, key=lambda point: point.coil_pole_rad_s)
    usable = usable_coil_pole(slowest, model.sample_time_s)
    current_pole = max(usable, 3.0 * unstable)
    triple = current_pole / 3.0
    return Backstepping(
        model=model,
        position_gain=triple**2 / 3.0,
        velocity_gain=triple + unstable**2 / (3.0 * triple),
        current_gain_ohm=max(current_pole - slowest.coil_pole_rad_s, 0.0) * slowest.inductance_H,
    )
