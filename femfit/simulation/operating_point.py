"""Where the body hangs at rest, and the linear model around it.

At rest F(d, i) = F_0(d), the weight with springs and load, and U = R i. Around that point, with
x = (distance, velocity, current) and the viscous friction c,

    x' = A x + B u,    A = [[0, 1, 0], [-S/m, -c/m, -k_m/m], [0, k_m/L, -R/L]],    B = [0, 0, 1/L].

S = F_d - F_0' < 0 makes the point unstable: the mechanical pole without back-EMF and friction is sqrt(-S/m).

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 5.1.
C. F. Van Loan, IEEE Trans. Automat. Contr. 23 (1978) 395, for the matrix exponential of (A, B).
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import DomainError
from femfit.filters.holding import holding_current
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.constants import USABLE_PART

_NEWTON_STEPS, _STEPS_FROM_NEAR = 40, 5


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """A point of rest and its linear model."""

    distance_m: float
    current_A: float
    voltage_V: float
    unstable_pole_rad_s: float  # sqrt(-S/m) where the point is unstable, 0 where it is stable
    coil_pole_rad_s: float
    inductance_H: float
    # x' = A x + B u with x in (m, m/s, A) and u in V; shapes (3, 3) and (3,)
    A: FloatArray
    B: FloatArray

    def discrete(self, step: float) -> tuple[FloatArray, FloatArray]:
        """(Phi, Gamma) of x(k+1) = Phi x(k) + Gamma u(k), the voltage held over a step in s."""
        return zero_order_hold(self.A, self.B, step)


def operating_point(model: ActuatorModel, distance: float) -> OperatingPoint:
    """The point of rest at a distance."""
    circuit, motion = model.require_circuit(), model.require_motion()
    current = holding_current(model, distance)
    if not circuit.voltage_min_V <= circuit.resistance_ohm * current <= circuit.voltage_max_V:
        raise DomainError(
            f"The driver must hold {1e3 * motion.mass_kg:g} g at {1e3 * distance:g} mm with a voltage of "
            f"{circuit.voltage_min_V:g}..{circuit.voltage_max_V:g} V; model {model.name!r} needs "
            f"{circuit.resistance_ohm * current:.4g} V there. Choose another reference distance, or change the body's "
            "mass or the supply in the actuator file."
        )
    d, i = np.array([distance]), np.array([current])
    magnetic = model.magnetics.state(d, i)
    gradient = float((model.magnetics.force_gradient(d, i) - motion.static_gradient(d))[0])
    inductance, motional = float(magnetic.inductance[0]), float(magnetic.motional_constant[0])
    mass, resistance = motion.mass_kg, circuit.resistance_ohm
    A = np.array(
        [
            [0.0, 1.0, 0.0],
            [-gradient / mass, -motion.viscous_N_s_per_m / mass, -motional / mass],
            [0.0, motional / inductance, -resistance / inductance],
        ]
    )
    return OperatingPoint(
        distance_m=distance,
        current_A=current,
        voltage_V=resistance * current,
        unstable_pole_rad_s=float(np.sqrt(max(-gradient / mass, 0.0))),
        coil_pole_rad_s=resistance / inductance,
        inductance_H=inductance,
        A=A,
        B=np.array([0.0, 0.0, 1.0 / inductance]),
    )


def usable_coil_pole(point: OperatingPoint, step: float) -> float:
    """The coil's pole that a controller may count on: its own, but slow enough for the samples.

    An air coil's R/L is beyond what a sampled loop can use: gains made for it would act within one sample.
    """
    return min(point.coil_pole_rad_s, USABLE_PART / step)


def current_range(model: ActuatorModel) -> tuple[float, float]:
    """The currents in A that the driver's clamp can hold and the model covers, from the weakest force to the largest.

    Steel alone is attracted by either sign of the current: its range begins at zero.
    """
    circuit, box = model.require_circuit(), model.validity
    low = max(circuit.voltage_min_V / circuit.resistance_ohm, box.current_min_A)
    high = min(circuit.voltage_max_V / circuit.resistance_ohm, box.current_max_A)
    return model.attracting_range(low, high)


def current_for_force(
    model: ActuatorModel, distance: FloatArray, force: FloatArray, near: FloatArray | None = None
) -> FloatArray:
    """The current that gives a force: F(d, i) = force, kept between the currents of :func:`current_range`.

    Newton's iteration from the largest current: dF/di rises with the current in an unsaturated actuator, so that it
    approaches the root from one side. Where no current of the range gives the force, the nearer end is returned.
    From currents ``near`` the solution a few steps are tried first.
    """
    everywhere = np.full(np.shape(distance), np.inf)
    if near is None:
        return _newton(model, distance, force, everywhere, _NEWTON_STEPS)[0]
    current, converged = _newton(model, distance, force, near, _STEPS_FROM_NEAR)
    if converged.all():
        return current
    return np.where(converged, current, _newton(model, distance, force, everywhere, _NEWTON_STEPS)[0])


def _newton(
    model: ActuatorModel, distance: FloatArray, force: FloatArray, start: FloatArray, steps: int
) -> tuple[FloatArray, BoolArray]:
    """Currents, and which converged; each stops by itself, so that it does not depend on the others."""
    low, high = current_range(model)
    scale = max(abs(low), abs(high))  # the range may end at zero: a magnet that a negative current holds back
    current = np.clip(start, low, high)
    changing = np.ones(np.shape(distance), dtype=np.bool_)
    for _ in range(steps):
        slope_d, slope_di = model.magnetics.coenergy_derivatives(distance, current, ((1, 0), (1, 1)))
        slope = np.maximum(-slope_di, 1e-12 * np.abs(slope_d) / scale + np.finfo(np.float64).tiny)
        updated = np.where(changing, np.clip(current - (-slope_d - force) / slope, low, high), current)
        changing = np.abs(updated - current) > 1e-6 * scale  # the next change would be its square
        current = updated
        if not changing.any():
            break
    return current, ~changing


def current_for_acceleration(
    model: ActuatorModel,
    distance: FloatArray,
    acceleration: FloatArray,
    velocity: FloatArray | float = 0.0,
    near: FloatArray | None = None,
) -> FloatArray:
    """The current for which F(d, i) = F_0(d) - c v - m a, a along growing distance, as :func:`current_for_force`.

    Dry friction is left to the feedback: taken from an estimate of the velocity it would chatter about rest.
    """
    motion = model.require_motion()
    return current_for_force(model, distance, motion.force_to_accelerate(distance, velocity, acceleration), near)


def zero_order_hold(A: FloatArray, B: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Discretise x' = A x + B u with u held: exp of [[A, B], [0, 0]] by scaling, Taylor series and squaring."""
    n = len(B)
    M = np.zeros((n + 1, n + 1))
    M[:n, :n], M[:n, n] = A * step, B * step
    squarings = max(0, int(np.ceil(np.log2(max(float(np.linalg.norm(M, 1)), 1e-300)))) + 4)
    M = M / 2.0**squarings
    term, result = np.eye(n + 1), np.eye(n + 1)
    for k in range(1, 13):  # |M| <= 1/16: the 13th term is below 1e-24
        term = term @ M / k
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result[:n, :n], result[:n, n]
