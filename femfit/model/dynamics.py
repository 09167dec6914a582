"""The equations of motion that plant and filters share.

State (d, v, i_1..i_n): d' = v, v' = g + (springs and load - friction - F(d, i)) / m, and from U = R i + L_s i' +
d(flux linkage)/dt with d(flux linkage)/dt = L i' - k_m v, (L + L_s) i' = U - R i + k_m v, with what is in series
with each coil in the diagonal L_s. Eddy currents are further windings without a voltage
(:mod:`femfit.model.windings`). Stops are left to :mod:`femfit.simulation`.

In all functions ``state`` has the shape (..., order): distance in m, velocity in m/s (positive: falling away), the
currents in A in the order of ``model.circuits``, those of ``model.eddy_names``, and after them ``model.memory_names``.
``voltage``, across each
circuit in V, has the shape (..., n), and (...) of one circuit; ``disturbance``, a further force along growing distance
in N, has the shape (...). Both are held over a step. Jacobians have the shape (..., order, order): row, component of
the result; column, component of the state.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (2) and (3), with 1/m, the sign of the current's force and
the back-EMF that their (32) lacks.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from femfit.core.numerics import FloatArray, central_differences
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import MagneticSlopes, MagneticState
from femfit.model.sensed_effects import ReadField
from femfit.model.windings import solved

LONGEST_STEP = 1.0
"""Derived: step of a Runge-Kutta method of fourth order over a decaying current's time constant; it is stable up to
2.8, and off by 1/120 of the decay's fifth power at one."""

FLUX_STEPS, FLUX_CHANGE = 20, 1e-10
"""Numerical: Newton's method on a flux linkage that grows with the current ends within a handful of steps."""


def state_derivative(
    model: ActuatorModel, state: FloatArray, voltage: FloatArray, disturbance: FloatArray | float = 0.0
) -> FloatArray:
    """Time derivative of (distance, velocity, currents), and of the states that the model's effects add."""
    motion, windings = model.require_motion(), model.windings
    if model.circuits and model.dynamics is not None and model.dynamics.drives:
        return model.dynamics.derivative(state, voltage, disturbance, motion, model.sample_time_s)
    end = windings.end
    distance, velocity, currents = state[..., 0], state[..., 1], state[..., 2:end]
    magnetic = windings.magnetics.state(distance, currents)
    rates = np.zeros(state.shape[::-1]).T  # a component's values together
    rates[..., 0] = velocity
    rates[..., 1] = motion.acceleration(distance, velocity, magnetic.force - disturbance, model.sample_time_s)
    if end > 2:
        rates[..., 2:end] = current_rates(model, magnetic, velocity, currents, voltage)
    return rates


def current_rates(
    model: ActuatorModel,
    magnetic: MagneticState,
    velocity: FloatArray,
    currents: FloatArray,
    voltage: FloatArray,
) -> FloatArray:
    """The derivatives (L + L_s)^-1 (U - R i + k_m v) of all windings' currents, of shape (..., n + r)."""
    windings = model.windings
    volts = windings.voltages(np.asarray(voltage)[..., None] if windings.circuits == 1 else np.asarray(voltage))
    driving = volts - windings.resistances_ohm * currents + magnetic.motional_constant * velocity[..., None]
    return solved(magnetic.inductance + windings.series_H, driving[..., None])[..., 0]


def runge_kutta_step(
    model: ActuatorModel,
    state: FloatArray,
    voltage: FloatArray,
    step: FloatArray | float,
    substeps: int = 1,
    disturbance: FloatArray | float = 0.0,
) -> FloatArray:
    """Advance by classical fourth-order Runge-Kutta with equal substeps; steps of their own have the shape (..., 1)."""
    h = step / substeps
    for _ in range(substeps):
        k1 = state_derivative(model, state, voltage, disturbance)
        k2 = state_derivative(model, state + 0.5 * h * k1, voltage, disturbance)
        k3 = state_derivative(model, state + 0.5 * h * k2, voltage, disturbance)
        k4 = state_derivative(model, state + h * k3, voltage, disturbance)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state


def currents_of_same_flux(
    model: ActuatorModel, currents: FloatArray, before: FloatArray, after: FloatArray
) -> FloatArray:
    """All windings' currents (N, n + r) at other distances that link the same flux, by Newton."""
    windings = model.windings
    if not currents.shape[1]:
        return currents

    def linked(distance: FloatArray, at: FloatArray) -> FloatArray:
        return np.asarray(windings.magnetics.flux_linkage(distance, at) + at @ windings.series_H)

    wanted, result = linked(before, currents), currents
    for _ in range(FLUX_STEPS):
        inductance = windings.magnetics.state(after, result).inductance + windings.series_H
        change = solved(inductance, (wanted - linked(after, result))[..., None])[..., 0]
        result = result + change
        if np.abs(change).max(initial=0.0) <= FLUX_CHANGE * np.abs(result).max(initial=0.0):
            break
    return result


def state_jacobian(model: ActuatorModel, state: FloatArray, voltage: FloatArray) -> FloatArray:
    """Jacobian of :func:`state_derivative` with respect to the state.

    With F and k_m = dF/di, and dk_m,j/di_k = -dL_jk/dd by reciprocity, for L i' = N and N = U - R i + k_m v:
    L di'/dd = dk_m/dd v - dL/dd i', L di'/dv = k_m, L di'/di_k = -R_k e_k - dL/dd e_k v - dL/di_k i', L with what is
    in series. Central differences where effects change these equations.
    """
    model.require_motion(), model.require_circuits()
    if model.dynamics is not None and model.dynamics.drives:
        return by_differences(partial(state_derivative, model), model, state, voltage)
    windings = model.windings
    end = windings.end
    distance, velocity, currents = state[..., 0], state[..., 1], state[..., 2:end]
    slopes = windings.magnetics.slopes(distance, currents)
    result = np.zeros((*state.shape, state.shape[-1]))
    result[..., 0, 1] = 1.0
    result[..., 1, :end] = acceleration_slopes(model, state, slopes)
    if end > 2:
        rate = current_rates(model, slopes, velocity, currents, voltage)
        result[..., 2:end, :end] = current_slopes(model, slopes, velocity, rate)
    return result


def acceleration_slopes(model: ActuatorModel, state: FloatArray, slopes: MagneticSlopes) -> FloatArray:
    """Derivatives of the acceleration by distance, velocity and currents, of shape (..., 2 + n + r)."""
    motion, distance, velocity = model.require_motion(), state[..., 0], state[..., 1]
    result = np.empty((*distance.shape, model.windings.end))
    result[..., 0] = motion.static_gradient(distance) - slopes.force_gradient
    result[..., 1] = motion.friction_slope(velocity, model.sample_time_s)
    result[..., 2:] = -slopes.motional_constant
    return np.asarray(result / motion.mass_kg)


def current_slopes(model: ActuatorModel, slopes: MagneticSlopes, velocity: FloatArray, rate: FloatArray) -> FloatArray:
    """Derivatives of currents' rates (..., n + r) by distance, velocity and currents, (..., n + r, 2 + n + r)."""
    v, windings = velocity[..., None], model.windings
    right = np.empty((*rate.shape, windings.end))
    right[..., 0] = slopes.motional_gradient * v - np.einsum("...jk,...k->...j", slopes.inductance_gradient, rate)
    right[..., 1] = slopes.motional_constant
    right[..., 2:] = (
        -np.diag(windings.resistances_ohm)
        - slopes.inductance_gradient * v[..., None]
        - np.einsum("...jkl,...k->...jl", slopes.inductance_slope, rate)
    )
    return solved(slopes.inductance + windings.series_H, right)


def by_differences(
    function: Callable[[FloatArray, FloatArray], FloatArray],
    model: ActuatorModel,
    state: FloatArray,
    voltage: FloatArray,
) -> FloatArray:
    """Jacobian of a function of states and voltages by central differences as wide as a sample moves a state."""
    order = state.shape[-1]
    circuits = () if len(model.circuits) == 1 else (len(model.circuits),)
    flat = state.reshape(-1, order)
    volts = np.broadcast_to(voltage, (*state.shape[:-1], *circuits)).reshape(-1, *circuits)
    slopes = central_differences(
        lambda points: function(points, np.concatenate([volts] * (2 * order))), flat, state_scale(model)
    )
    return slopes.reshape(*state.shape, order)


def state_scale(model: ActuatorModel) -> FloatArray:
    """What is large for each state: a body takes some hundred samples through its stroke."""
    box, memory = model.validity, model.dynamics.spreads if model.dynamics is not None else np.zeros(0)
    stroke = box.distance_max_m - box.distance_min_m
    widths = np.ptp(box.current_limits_A, axis=1)[: len(model.circuits)]
    speed = 0.01 * stroke / model.sample_time_s
    return np.array([stroke, speed, *widths, *eddy_currents_of(model, widths, speed), *memory])


def eddy_currents_of(
    model: ActuatorModel, jumps: FloatArray, speed: float, distance: float | None = None
) -> FloatArray:
    """Currents in A that jumps of the circuits' currents leave in the eddy currents' patterns, and a speed drives.

    As if each pattern were alone: its flux linkage stays at a jump, and at a steady speed v it carries k_m v / R.
    """
    windings, n = model.windings, len(model.circuits)
    if model.eddy is None:
        return np.zeros(0)
    box = model.validity
    at = 0.5 * (box.distance_min_m + box.distance_max_m) if distance is None else distance
    middle = np.zeros(windings.count)
    middle[:n] = box.current_limits_A[:n].mean(axis=1)
    there = windings.magnetics.state(np.asarray(at), middle)
    left = np.abs(there.inductance[n:, :n]) @ np.asarray(jumps) / np.diag(there.inductance)[n:]
    return np.hypot(left, there.motional_constant[n:] * speed / windings.resistances_ohm[n:])


def hall_voltage(model: ActuatorModel, state: FloatArray, time: FloatArray | float = 0.0) -> FloatArray:
    """Output of the Hall element in V before noise and rounding; the time since the start matters to drifts alone."""
    sensor = model.require_sensor()
    if model.dynamics is None:
        if model.eddy_hall is None:
            if isinstance(sensor.field, ReadField):
                sensor = replace(sensor, field=sensor.field.after(time))
            return sensor.output(state[..., 0], model.currents_of(state))
        flat = state.reshape(-1, state.shape[-1])
        field = model.eddy_hall.field(flat[:, 0], flat[:, 2 : model.windings.end])
        return sensor.quiescent_V + sensor.sensitivity_V_per_T * field.reshape(state.shape[:-1])
    return model.dynamics.hall_voltage(state, sensor.quiescent_V, sensor.sensitivity_V_per_T, time)
