"""The equations of motion that plant and filters share.

State (d, v, i): d' = v, v' = g + (springs and load - friction - F(d, i)) / m, and from U = R i + d(flux linkage)/dt
with d(flux linkage)/dt = L i' - k_m v, i' = (U - R i + k_m v) / L. Stops are left to :mod:`femfit.open_loop`.

In all functions ``state`` has the shape (..., n): distance in m, velocity in m/s (positive: falling away), current in
A, and after them ``model.memory_names``. ``voltage``, across the winding in V, and ``disturbance``, a further force
along growing distance in N, have the shape (...) and are held over a step. Jacobians have the shape (..., n, n): row,
component of the result; column, component of the state.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (2) and (3), with 1/m, the sign of the current's force and
the back-EMF that their (32) lacks.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.differences import central_differences
from femfit.model.actuator_model import ActuatorModel


def state_derivative(
    model: ActuatorModel, state: FloatArray, voltage: FloatArray, disturbance: FloatArray | float = 0.0
) -> FloatArray:
    """Time derivative of (distance, velocity, currents), and of the states that the model's effects add.

    With n circuits the state has n currents and ``voltage`` the shape (..., n); without any it has none.
    """
    if len(model.circuits) != 1:
        return _of_any_circuits(model, state, voltage, disturbance)
    circuit, motion = model.require_circuit(), model.require_motion()
    if model.dynamics is not None and model.dynamics.drives:
        return model.dynamics.derivative(state, voltage, disturbance, motion, model.sample_time_s)
    distance, velocity, current = state[..., 0], state[..., 1], state[..., 2]
    magnetic = model.magnetics.state(distance, current)
    rates = np.empty((3, *distance.shape))  # a component's values together, whatever the order of ``state``
    rates[0] = velocity
    rates[1] = motion.acceleration(distance, velocity, magnetic.force - disturbance, model.sample_time_s)
    rates[2] = (
        voltage - circuit.resistance_ohm * current + magnetic.motional_constant * velocity
    ) / magnetic.inductance
    return np.moveaxis(rates, 0, -1) if rates.ndim != 2 else rates.T


def _of_any_circuits(
    model: ActuatorModel, state: FloatArray, voltage: FloatArray, disturbance: FloatArray | float
) -> FloatArray:
    """The same for no circuit or several: L i' = U - R i + k_m v with the matrix L."""
    motion, circuits = model.require_motion(), model.circuits
    distance, velocity, currents = state[..., 0], state[..., 1], state[..., 2 : 2 + len(circuits)]
    rates = np.zeros_like(state)
    rates[..., 0] = velocity
    if not circuits:
        force = model.magnetics.force(distance, np.zeros_like(distance))
    else:
        magnetic = model.magnetics.state(distance, currents)
        resistance, series = np.array([(one.resistance_ohm, one.inductance_H) for one in circuits]).T
        force, inductance = magnetic.force, magnetic.inductance + np.diag(series)
        driving = voltage - resistance * currents + magnetic.motional_constant * velocity[..., None]
        rates[..., 2 : 2 + len(circuits)] = np.linalg.solve(inductance, driving[..., None])[..., 0]
    rates[..., 1] = motion.acceleration(distance, velocity, force - disturbance, model.sample_time_s)
    return rates


def euler_step(model: ActuatorModel, state: FloatArray, voltage: FloatArray, step: float) -> FloatArray:
    """One explicit Euler step, as in eq. (33) of the source."""
    return state + step * state_derivative(model, state, voltage)


def runge_kutta_step(
    model: ActuatorModel,
    state: FloatArray,
    voltage: FloatArray,
    step: float,
    substeps: int = 1,
    disturbance: FloatArray | float = 0.0,
) -> FloatArray:
    """Advance by classical fourth-order Runge-Kutta with equal substeps."""
    h = step / substeps
    for _ in range(substeps):
        k1 = state_derivative(model, state, voltage, disturbance)
        k2 = state_derivative(model, state + 0.5 * h * k1, voltage, disturbance)
        k3 = state_derivative(model, state + 0.5 * h * k2, voltage, disturbance)
        k4 = state_derivative(model, state + h * k3, voltage, disturbance)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return state


def state_jacobian(model: ActuatorModel, state: FloatArray, voltage: FloatArray) -> FloatArray:
    """Jacobian of :func:`state_derivative` with respect to the state.

    With F and k_m = dF/di, and dk_m/di = -dL/dd by reciprocity, for i' = N / L and N = U - R i + k_m v:
    di'/dd = (dk_m/dd v - i' dL/dd) / L, di'/dv = k_m / L, di'/di = (-R - dL/dd v - i' dL/di) / L. Central differences
    where effects change these equations.
    """
    circuit, motion = model.require_circuit(), model.require_motion()
    if model.dynamics is not None and model.dynamics.drives:
        return _difference_jacobian(model, state, voltage)
    distance, velocity, current = state[..., 0], state[..., 1], state[..., 2]
    orders = ((2, 0), (1, 1), (2, 1), (0, 2), (1, 2), (0, 3))
    dd_w, di_w, ddi_w, inductance, dii_w, iii_w = model.magnetics.coenergy_derivatives(distance, current, orders)
    rate = (voltage - circuit.resistance_ohm * current - di_w * velocity) / inductance
    result = np.zeros((*state.shape[:-1], 3, 3))
    result[..., 0, 1] = 1.0
    result[..., 1, 0] = (dd_w + motion.static_gradient(distance)) / motion.mass_kg
    result[..., 1, 1] = motion.friction_slope(velocity, model.sample_time_s) / motion.mass_kg
    result[..., 1, 2] = di_w / motion.mass_kg
    result[..., 2, 0] = (-ddi_w * velocity - rate * dii_w) / inductance
    result[..., 2, 1] = -di_w / inductance
    result[..., 2, 2] = (-circuit.resistance_ohm - dii_w * velocity - rate * iii_w) / inductance
    return result


def _difference_jacobian(model: ActuatorModel, state: FloatArray, voltage: FloatArray) -> FloatArray:
    order = state.shape[-1]
    flat, volts = state.reshape(-1, order), np.broadcast_to(voltage, state.shape[:-1]).ravel()
    box, memory = model.validity, model.dynamics.spreads if model.dynamics is not None else np.zeros(0)
    stroke = box.distance_max_m - box.distance_min_m
    # A body takes some hundred samples through its stroke
    scale = np.array([stroke, 0.01 * stroke / model.sample_time_s, box.current_max_A - box.current_min_A, *memory])
    slopes = central_differences(lambda points: state_derivative(model, points, np.tile(volts, 2 * order)), flat, scale)
    return slopes.reshape(*state.shape, order)


def hall_voltage(model: ActuatorModel, state: FloatArray, time: FloatArray | float = 0.0) -> FloatArray:
    """Output of the Hall element in V before noise and rounding; the time since the start matters to drifts alone."""
    sensor = model.require_sensor()
    if model.dynamics is None:
        return sensor.voltage(state[..., 0], state[..., 2])
    return model.dynamics.hall_voltage(state, sensor.quiescent_V, sensor.sensitivity_V_per_T, time)


def euler_jacobian(model: ActuatorModel, state: FloatArray, voltage: FloatArray, step: float) -> FloatArray:
    """Jacobian of :func:`euler_step`."""
    return np.eye(state.shape[-1]) + step * state_jacobian(model, state, voltage)
