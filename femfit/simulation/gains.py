"""Gains of controllers from the linear model of a point of rest, for a bandwidth.

References
----------
K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (Prentice Hall, 1997), chapter 5 (pole placement) and
section 11.1 (linear-quadratic regulator).
"""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import commands_currents
from femfit.simulation import constants
from femfit.simulation.allocation import limits_of
from femfit.simulation.controllers import Backstepping, Pid, StateFeedback
from femfit.simulation.linear_loop import LinearPlant
from femfit.simulation.operating_point import OperatingPoint, solve_riccati, usable_coil_pole, zero_order_hold


def design_backstepping(
    model: ActuatorModel, points: Sequence[OperatingPoint], bandwidth_rad_s: float | None = None
) -> Backstepping:
    """Gains from the model's poles, for the fastest unstable pole lambda and the slowest coil among the points.

    The current follows i* with the pole p = (R + K_i)/L. Linearised, with lambda^2 = -F_d/m,

        s^3/p + s^2 + (k_v - lambda^2/p) s + k_p = 0,

    so a velocity gain below (lambda^2 + k_p)/p leaves the loop unstable. The poles sum up to -p; the slowest of them
    is fastest as the triple pole w = p/3: k_p = w^2/3, k_v = w + lambda^2/(3 w). K_i = 0 (the paper's form, p = R/L) is
    kept as long as w is faster than lambda; otherwise K_i raises p to 3 lambda. A coil that is faster than the samples
    is taken as slow as they can follow. A given bandwidth is w, as far as K_i >= 0 allows.
    """
    unstable = max(point.unstable_pole_rad_s for point in points)
    slowest = min(points, key=lambda point: point.coil_pole_rad_s)
    current_pole = max(usable_coil_pole(model, slowest), 3.0 * unstable)
    if bandwidth_rad_s is not None:
        current_pole = max(3.0 * bandwidth_rad_s, slowest.coil_pole_rad_s)
    triple = current_pole / 3.0 if bandwidth_rad_s is None else bandwidth_rad_s
    return Backstepping(
        model=model,
        position=triple**2 / 3.0,
        velocity=triple + unstable**2 / (3.0 * triple),
        current=max(current_pole - slowest.coil_pole_rad_s, 0.0) * slowest.inductance_H,
    )


def design_pid(model: ActuatorModel, point: OperatingPoint, bandwidth_rad_s: float | None = None) -> Pid:
    """Gains by pole placement at one operating point.

    With the plant's G = c/A held over a sample (orders 2 and 3) the closed loop is

        A(z) (z - 1)(z - p) + c(z) (b_0 z^2 + b_1 z + b_2) = (z - q)^4 (z - q_5).

    Its coefficients are linear in p, b_0, b_1, b_2 and q_5: for a wanted quadruple pole q = exp(-w t_s) they follow
    from one 5 x 5 system. In continuous time, with the coil's pole p_c and the derivative filter's N, equal powers of s
    give 10 w^2 - 4 (p_c + N) w + N p_c - lambda^2 = 0, and a choice of N picks w
    unless it is given.

    Raises
    ------
    DomainError
        If the coil is slower than the body.
    """
    step, unstable = model.sample_time_s, point.unstable_pole_rad_s
    A, B, current = reduced(model, point)
    coil = min(-float(A[2, 2]), constants.USABLE_PART / step) if current else usable_coil_pole(model, point)
    derivative = constants.DERIVATIVE_FILTER_RATIO * coil
    half = 4.0 * (coil + derivative)
    w = (half - np.sqrt(half**2 - 40.0 * (derivative * coil - unstable**2))) / 20.0
    w = w if bandwidth_rad_s is None else bandwidth_rad_s
    if w <= 0.0:
        raise DomainError(
            f"Four equal poles need a coil that is faster than the body; at {1e3 * point.distance_m:g} mm R/L is "
            f"{coil:.4g} rad/s, the body's unstable pole {unstable:.4g} rad/s. Use backstepping or state feedback, "
            "which feed back the current, or a coil with less inductance."
        )
    phi, gamma = zero_order_hold(A, B, step)
    a = np.poly(phi).real
    c = np.poly(phi - np.outer(gamma, [1.0, 0.0, 0.0])).real - a  # c(z) of distance/command, order 2
    integrated = np.polymul(a, [1.0, -1.0])
    wanted = np.poly(np.full(4, np.exp(-w * step)))
    columns = np.zeros((5, 5))
    columns[:, 0] = -integrated
    for power in range(3):
        columns[power : power + 3, 1 + power] = c[1:]
    columns[:, 4] = wanted
    right = np.polymul(wanted, [1.0, 0.0])[1:] - np.polymul(integrated, [1.0, 0.0])[1:]
    p, b0, b1, b2, _ = np.linalg.solve(columns, right).tolist()
    each = -(b0 + b1 + b2) / (1.0 - p)  # of the integral in a sample
    kp = (b2 - b0 - each) / (1.0 - p)
    return Pid(model, kp, each / step, -(b2 + kp * p) * step / (1.0 - p), p, tuple(point.direction.tolist()), current)


def first_pid(model: ActuatorModel, point: OperatingPoint) -> Pid:
    """That of equal poles; where there is no room for them, one from which a search may start.

    More force than the unstable pole asks for, damped at the body's own rate.
    """
    with suppress(DomainError):
        return design_pid(model, point)
    A, B, current = reduced(model, point)
    coil, rate = -A[2, 2], max(point.natural_rad_s, constants.SLOWEST_OVER_HIGHEST * usable_coil_pole(model, point))
    per_command = abs(A[1, 2] * B[2]) / coil
    kp = constants.FIRST_STIFFNESS * (rate**2 + coil * rate) / per_command
    ki, kd = constants.FIRST_INTEGRAL * rate * kp, constants.FIRST_DAMPING * kp / rate
    pole = float(np.exp(-constants.FIRST_FILTER * rate * model.sample_time_s))
    return Pid(model, kp, ki, kd, pole, tuple(point.direction.tolist()), current)


def reduced(model: ActuatorModel, point: OperatingPoint) -> tuple[FloatArray, FloatArray, float]:
    """Distance, velocity and the current along the controller's direction: A (3, 3), B (3,) and an inner gain in ohm.

    Of one circuit it is the point's own model; of several that of a current shared so; of an amplifier its bandwidth.
    The inner gain is that of a loop of the current which makes a coil fast enough for the body; zero where it is so
    itself.
    """
    gain, coil, body = 0.0, point.coil_pole_rad_s, point.unstable_pole_rad_s
    if coil < constants.SLOW_COIL * body:
        wanted = min(constants.WANTED_COIL * body, constants.USABLE_PART / model.sample_time_s)
        gain = max(0.0, float(model.resistances_ohm.max()) * (wanted / coil - 1.0))
    amplified, along = bool(commands_currents(model).any()), point.direction
    share = along if amplified else along / model.resistances_ohm  # currents at rest for such a command
    unit = share / (share @ share)
    A, B = np.zeros((3, 3)), np.zeros(3)
    A[:2, :2] = point.A[:2, :2]
    A[1, 2] = point.A[1, 2:] @ share
    if amplified:
        B[2] = usable_coil_pole(model, point)
        A[2, 2] = -B[2]
    else:
        A[2, 1] = unit @ point.A[2:, 1]
        A[2, 2] = unit @ (point.A[2:, 2:] - gain * point.B[2:]) @ share
        B[2] = unit @ point.B[2:] @ ((1.0 + gain / model.resistances_ohm) * along)
    return A, B, gain


INTEGRAL_PART = 0.25
"""Conventional: rate at which the integral acts over the bandwidth; at a quarter it costs some 15 degrees of phase."""


def regulator(
    model: ActuatorModel, point: OperatingPoint, plant: LinearPlant, bandwidth_rad_s: float, latency: int = 0
) -> StateFeedback:
    """The linear-quadratic regulator of a bandwidth.

    It is designed on the sampled linear model with the integral as a state, z = (x, q) and z+ = A z + B u. Distance and
    integral are weighed against the commands; the weights are those that put the poles of the ideal chain from command
    to distance on a circle whose radius is the bandwidth (Butterworth's pattern). Commands that act q samples late are
    those for the state q samples on, which follows from the commands on their way:

        u = -K z(k + q),    z(k + q) = A^q z(k) + B u(k - 1) + A B u(k - 2) + ..
    """
    n = len(point.commands)
    order = 2 + n  # states of effects follow the currents and are not fed back
    A, B = np.eye(order + 1), np.zeros((order + 1, n))
    A[:order, :order], B[:order] = plant.A[:order, :order], plant.B[:order]
    A[-1, 0] = model.sample_time_s
    low, high = limits_of(model)
    span = np.where(np.isfinite(high - low), high - low, 1.0)
    # Distance per command far above all poles: k_m / (m L s^3) behind a voltage, k_m / (m s^2) behind an amplifier
    per_current, amplified = point.A[1, 2:], commands_currents(model)
    per_command = np.where(amplified, per_current, per_current @ point.B[2:])
    relative = 2.0 if amplified.all() else 3.0
    weight = bandwidth_rad_s ** (2.0 * relative) / float(np.sum((per_command * span) ** 2))
    Q, R = np.zeros_like(A), np.diag(1.0 / span**2)
    Q[0, 0] = weight
    Q[-1, -1] = weight * (INTEGRAL_PART * bandwidth_rad_s) ** 2
    X = solve_riccati(A, B, Q, R)
    gain, pending = np.asarray(np.linalg.solve(R + B.T @ X @ B, B.T @ X @ A), np.float64), [np.zeros((n, 0))]
    for _ in range(latency):
        pending.append(gain @ B)
        gain = gain @ A
    return StateFeedback(model, gain[:, :order], gain[:, -1], np.hstack(pending), point.direction)
