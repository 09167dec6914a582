"""The step of the filters: currents decay exactly, and the body drifts half the way before and after.

From (d, v, i) with the voltage held over a step h: the magnetics are evaluated once, at d + h v / 2. There

    a = v'(v, i),  r = (L + L_s)^-1 (U - R i + k_m (v + h a / 2)),
    i+ = i + h f1 r,  v+ = v + h a - h^2 k_m f2 r / m,  d+ = d + h (v + v+) / 2,

with f1 and f2 of :mod:`femfit.model.windings`: the force is that of the step's mean current. The step is exact for a
current that decays at rest, however fast, and of second order in the motion and in what the motion induces.

References
----------
M. Hochbruck and A. Ostermann, Acta Numerica 19 (2010) 209, eq. (2.6): the exponential Euler method for the currents.
E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration (Springer, 2006), section I.1.4: drift, kick, drift.
E. Hairer, S. P. Norsett and G. Wanner, Solving Ordinary Differential Equations I (Springer, 1993), section II.9:
extrapolation of a method of first order, eqs. (9.2) and (9.10) with the harmonic sequence.
"""

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import acceleration_slopes, by_differences, current_rates, current_slopes
from femfit.model.tabulated_step import StepTable, step_table, tabulated_kick, tabulated_step
from femfit.model.windings import decay_of

LONGEST_MOTION = 0.5
"""Chosen: extrapolated step times the rate of the motion; where that is fastest, one such step is off by 3e-4 of the
change of speed, and two of half the length by a fifteenth of this."""


def exponential_step(
    model: ActuatorModel, state: FloatArray, voltage: FloatArray, step: FloatArray | float
) -> FloatArray:
    """States (..., order) one step later; arguments as in :mod:`femfit.model.dynamics`.

    Steps of their own have the shape (..., 1); not of models whose effects drive.
    """
    if isinstance(step, np.ndarray) or (table := _table(model, step)) is None:
        return _exact_step(model, state, voltage, step)
    flat, volts = _flat(model, state, voltage)
    result, beyond = tabulated_step(model, table, flat, volts, step)
    if len(beyond):
        result[beyond] = _exact_step(model, flat[beyond], volts[beyond], step)
    return result.reshape(state.shape)


def _table(model: ActuatorModel, step: float) -> StepTable | None:
    """What the step needs at any distance, where effects and currents have no say in it."""
    if model.eddy is None or (model.dynamics is not None and model.dynamics.drives):
        return None
    return step_table(model.windings, step)


def _flat(model: ActuatorModel, state: FloatArray, voltage: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States (N, order) and the voltages at each, (N,) or (N, n)."""
    if state.ndim == 2 and np.ndim(voltage) and len(voltage) == len(state):
        return state, voltage
    circuits = () if len(model.circuits) == 1 else (len(model.circuits),)
    volts = np.broadcast_to(voltage, (*state.shape[:-1], *circuits))
    return state.reshape(-1, state.shape[-1]), volts.reshape(-1, *circuits)


def _exact_step(model: ActuatorModel, state: FloatArray, voltage: FloatArray, step: FloatArray | float) -> FloatArray:
    middle = half_way(state, step)
    if model.dynamics is not None and model.dynamics.drives and not isinstance(step, np.ndarray):
        motion = model.require_motion()
        rates = model.dynamics.derivative(middle, voltage, 0.0, motion, model.sample_time_s, mean_over=step)
    else:
        rates = _mean_rates(model, middle, voltage, step)
    result = np.asarray(state + step * rates)
    result[..., 0] = state[..., 0] + 0.5 * _of_each(step) * (state[..., 1] + result[..., 1])
    return result


def _of_each(step: FloatArray | float) -> FloatArray | float:
    return step[..., 0] if isinstance(step, np.ndarray) else step


def extrapolated_step(
    model: ActuatorModel, state: FloatArray, voltage: FloatArray, step: FloatArray | float
) -> FloatArray:
    """States one step later with an error of third order, as exact for a current that decays at rest.

    One step holds inductance and motional constant at its first currents, an error of first order where they change.
    From one, two and three steps over the same time follows what infinitely many would come to.
    """
    result = np.zeros_like(state)
    for count, weight in ((1, 0.5), (2, -4.0), (3, 4.5)):
        moved = state
        for _ in range(count):
            moved = exponential_step(model, moved, voltage, step / count)
        result += weight * moved
    return result


def motion_steps(model: ActuatorModel) -> int:
    """Extrapolated steps in a sample, which follow the body's motion over the validity domain."""
    return max(1, int(np.ceil(model.sample_time_s * _motion_rate(model) / LONGEST_MOTION)))


def _motion_rate(model: ActuatorModel) -> float:
    """Fastest rate in 1/s of the body's motion over the validity domain, from its stiffness at constant flux.

    The stiffness at held currents, with k_m L^-1 k_m of the currents that keep the flux.
    """
    windings, motion = model.windings, model.require_motion()
    d, i = model.validity.grid(5, 5, several=3)
    currents = np.zeros((len(d), windings.count))
    currents[:, : windings.circuits] = i[:, : windings.circuits]
    at = windings.magnetics.slopes(d, currents)
    answers = np.linalg.solve(at.inductance + windings.series_H, at.motional_constant[..., None])[..., 0]
    stiffness = np.abs(motion.static_gradient(d)) + np.abs(at.force_gradient)
    stiffness = stiffness + (at.motional_constant * answers).sum(axis=-1)
    return float(np.sqrt(stiffness.max() / motion.mass_kg))


def half_way(state: FloatArray, step: FloatArray | float) -> FloatArray:
    """States whose bodies have drifted for half a step."""
    middle = np.array(state)
    middle[..., 0] += 0.5 * _of_each(step) * middle[..., 1]
    return middle


def _mean_rates(model: ActuatorModel, state: FloatArray, voltage: FloatArray, step: FloatArray | float) -> FloatArray:
    """Rates of velocity and currents, meant over a step at a held distance."""
    h = _of_each(step)
    motion, windings = model.require_motion(), model.windings
    end = windings.end
    distance, velocity, currents = state[..., 0], state[..., 1], state[..., 2:end]
    at = windings.magnetics.state(distance, currents)
    rates = np.zeros(state.shape[::-1]).T  # a component's values together
    acceleration = motion.acceleration(distance, velocity, at.force, model.sample_time_s)
    rates[..., 1] = acceleration
    if end == 2:
        return rates
    rate = current_rates(model, at, velocity + 0.5 * h * acceleration, currents, voltage)
    decay = decay_of(at.inductance + windings.series_H, windings.resistances_ohm, step)
    rates[..., 2:end], lever = decay.parts(rate)
    rates[..., 1] -= h / motion.mass_kg * (at.motional_constant * lever).sum(axis=-1)
    return rates


def exponential_jacobian(model: ActuatorModel, state: FloatArray, voltage: FloatArray, step: float) -> FloatArray:
    """Jacobian of :func:`exponential_step`; by central differences where effects change the equations."""
    if model.dynamics is not None and model.dynamics.drives:
        return by_differences(lambda x, u: exponential_step(model, x, u, step), model, state, voltage)
    table = _table(model, step)
    if table is not None:
        flat, volts = _flat(model, state, voltage)
        kick, beyond = tabulated_kick(model, table, flat, volts, step)
        if len(beyond):
            kick[beyond] = _exact_kick(model, flat[beyond], volts[beyond], step)
        kick = kick.reshape(*state.shape, state.shape[-1])
    else:
        kick = _exact_kick(model, state, voltage, step)
    kick[..., :, 1] += 0.5 * step * kick[..., :, 0]  # the middle's distance holds half a step of the velocity
    kick[..., 0, :] = 0.5 * step * kick[..., 1, :]
    kick[..., 0, 0] += 1.0
    kick[..., 0, 1] += 0.5 * step
    return kick


def _exact_kick(model: ActuatorModel, state: FloatArray, voltage: FloatArray, step: float) -> FloatArray:
    """Derivatives of velocity and currents after a step by the state half way, (..., order, order)."""
    motion, windings = model.require_motion(), model.windings
    end = windings.end
    middle, order = half_way(state, step), state.shape[-1]
    distance, velocity, currents = middle[..., 0], middle[..., 1], middle[..., 2:end]
    slopes = windings.magnetics.slopes(distance, currents)
    row = acceleration_slopes(model, middle, slopes)
    kick = np.zeros((*state.shape, order))
    kick[..., range(order), range(order)] = 1.0
    kick[..., 1, :end] += step * row
    if end > 2:
        acceleration = motion.acceleration(distance, velocity, slopes.force, model.sample_time_s)
        seen = velocity + 0.5 * step * acceleration
        rate = current_rates(model, slopes, seen, currents, voltage)
        rows = current_slopes(model, slopes, seen, rate)
        rows = rows + 0.5 * step * rows[..., 1:2] * row[..., None, :]
        inductance = slopes.inductance + windings.series_H
        decay = decay_of(inductance, windings.resistances_ohm, step)
        _, lever = decay.parts(rate)
        changed = np.zeros((*inductance.shape, end))
        changed[..., 0], changed[..., 2:] = slopes.inductance_gradient, slopes.inductance_slope
        own, mean = decay.slopes(rate, changed, step)
        first, second = decay.applied(rows)
        kick[..., 2:end, :end] += step * (first + own)
        pull = np.zeros((*lever.shape, end))  # dk_m
        pull[..., 0], pull[..., 2:] = slopes.motional_gradient, -slopes.inductance_gradient
        along = (lever[..., None] * pull + slopes.motional_constant[..., None] * (second + mean)).sum(axis=-2)
        kick[..., 1, :end] -= step**2 / motion.mass_kg * along
    return kick
