"""The filter's view of a levitating magnet, built from the actuator model.

States are distance (m), velocity (m/s) and current (A), those that the model's effects add (lag, hysteresis), and, for
a Hall element whose quiescent voltage drifts, its bias (V) as a random walk. The measurement is the Hall voltage
through the fitted field, which lets the filter itself tell the coil's part from the magnet's, or the paper's distance,
compensated statically before the filter.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14), (32) and (33), as corrected in femfit.model.dynamics.
"""

from collections.abc import Callable
from functools import partial
from typing import Literal

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import FilterError
from femfit.filters.constants import BIAS_DEVIATION_V, FARTHEST, NEAREST
from femfit.filters.noise import (
    FilterNoise,
    default_noise,
    initial_covariance,
    operating_distance,
    process_covariance,
    with_memory,
)
from femfit.filters.process import FilterProcess, Measure
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import (
    euler_jacobian,
    euler_step,
    hall_voltage,
    runge_kutta_jacobian,
    runge_kutta_step,
)
from femfit.model.float_steps import float_euler_step, float_hall_voltage

Measurement = Literal["hall_voltage", "distance"]
Integrator = Literal["euler", "rk4"]

_LARGEST_STEP = {"euler": 2.0, "rk4": 2.785}
"""Largest stable step times R/L of a decaying current (E. Hairer and G. Wanner, Solving Ordinary Differential
Equations II (Springer, 1996), section IV.2)."""

STATE_NAMES = ("distance_m", "velocity_m_s", "current_A", "hall_bias_V")

Step = Callable[[ActuatorModel, FloatArray, FloatArray, float], FloatArray]

_STEPS: dict[str, tuple[Step, Step]] = {
    "euler": (euler_step, euler_jacobian),
    "rk4": (runge_kutta_step, runge_kutta_jacobian),
}


def levitation_process(
    model: ActuatorModel,
    *,
    hall_bias: bool = False,
    measurement: Measurement = "hall_voltage",
    integrator: Integrator = "euler",
    noise: FilterNoise | None = None,
    distance: float | None = None,
) -> FilterProcess:
    """Process and measurement of a hanging magnet with a Hall element.

    Parameters
    ----------
    hall_bias : bool
        Add the Hall bias in V as the last state.
    noise : FilterNoise or None
        Derived by :func:`default_noise` where None.
    distance : float or None
        Operating point in m where noise and inductance are taken; from the model's reference where None.

    Returns
    -------
    FilterProcess
        With 3 or 4 states and analytic Jacobians; with more, and central differences, where effects have states.
    """
    model.require_dynamics()
    sensor = model.require_sensor()
    if hall_bias and measurement == "distance":
        raise FilterError(
            "A Hall bias in V can only be estimated from the Hall voltage; use measurement='hall_voltage' with "
            "hall_bias=True, or leave the bias out."
        )
    distance = operating_distance(model) if distance is None else distance
    require_slow_coil(model, distance, integrator)
    noise = default_noise(model, distance) if noise is None else noise
    advance, jacobian = _STEPS[integrator]
    measure: Measure
    slope: Measure | None
    if measurement == "hall_voltage":
        measure, slope, variance = partial(_hall_voltage, model), partial(_hall_slope, model), noise.hall_V**2
        if model.memory_names or (model.dynamics is not None and model.dynamics.late):
            slope = None
    else:
        middle = 0.5 * (model.validity.current_min_A + model.validity.current_max_A)
        per_metre = sensor.sensitivity_V_per_T * sensor.field.derivatives(np.asarray(distance), np.asarray(middle))[1]
        measure, slope, variance = _distance, _distance_slope, float(noise.hall_V / per_metre) ** 2
    names = (*STATE_NAMES[:3], *model.memory_names, *(STATE_NAMES[3:] if hall_bias else ()))
    lower, upper = _plausible_range(model, len(names))
    return FilterProcess(
        names=names,
        step_s=model.sample_time_s,
        transition=partial(_transition, model, advance),
        measure=measure,
        process_covariance=process_covariance(model, noise, distance, hall_bias),
        measurement_variance=variance,
        transition_jacobian=partial(_transition_jacobian, model, jacobian),
        measurement_jacobian=slope,
        transition_columns=float_euler_step(model) if integrator == "euler" else None,
        measure_columns=float_hall_voltage(model) if measurement == "hall_voltage" else None,
        lower=lower,
        upper=upper,
        start_covariance=with_memory(model, initial_covariance(hall_bias_V=BIAS_DEVIATION_V if hall_bias else None)),
    )


def require_slow_coil(model: ActuatorModel, distance: float, integrator: Integrator = "euler") -> None:
    """Refuse a coil whose current one explicit step a sample cannot follow: its error would grow at every sample.

    Parameters
    ----------
    distance : float
        Where the inductance is taken, in m.
    """
    circuit, box = model.require_circuit(), model.validity
    currents = np.linspace(box.current_min_A, box.current_max_A, 5)
    inductance = float(model.magnetics.inductance(np.full(5, distance), currents).min())
    longest = _LARGEST_STEP[integrator] * inductance / circuit.resistance_ohm
    if model.sample_time_s > longest:
        raise FilterError(
            f"The filter of model {model.name!r} must take steps of at most {1e3 * longest:.3g} ms, because its coil "
            f"has L/R = {1e3 * inductance / circuit.resistance_ohm:.3g} ms; the sample time is "
            f"{1e3 * model.sample_time_s:g} ms. Give [supply] a shorter sample_time_ms, or drive the coil by a current "
            "loop with a larger resistance_ohm."
        )


def _transition(model: ActuatorModel, advance: Step, states: FloatArray, voltage: FloatArray) -> FloatArray:
    order = 3 + len(model.memory_names)
    if states.shape[1] == order:
        return advance(model, states, voltage, model.sample_time_s)
    result = np.empty(states.shape[::-1]).T
    result[:, :order] = advance(model, states[:, :order], voltage, model.sample_time_s)
    result[:, order:] = states[:, order:]
    return result


def _transition_jacobian(model: ActuatorModel, jacobian: Step, states: FloatArray, voltage: FloatArray) -> FloatArray:
    order, moving = states.shape[1], 3 + len(model.memory_names)
    result = np.zeros((len(states), order, order))
    result[:, :moving, :moving] = jacobian(model, states[:, :moving], voltage, model.sample_time_s)
    result[:, moving:, moving:] = 1.0
    return result


def _hall_voltage(model: ActuatorModel, states: FloatArray) -> FloatArray:
    order = 3 + len(model.memory_names)
    volts = hall_voltage(model, states[:, :order])
    return volts if states.shape[1] == order else volts + states[:, order]


def _hall_slope(model: ActuatorModel, states: FloatArray) -> FloatArray:
    sensor = model.require_sensor()
    _, in_distance, in_current = sensor.field.derivatives(states[:, 0], states[:, 2])
    result = np.zeros_like(states)
    result[:, 0] = sensor.sensitivity_V_per_T * in_distance
    result[:, 2] = sensor.sensitivity_V_per_T * in_current
    result[:, 3:] = 1.0
    return result


def _distance(states: FloatArray) -> FloatArray:
    return states[:, 0]


def _distance_slope(states: FloatArray) -> FloatArray:
    result = np.zeros_like(states)
    result[:, 0] = 1.0
    return result


def _plausible_range(model: ActuatorModel, order: int) -> tuple[FloatArray, FloatArray]:
    """Distances around the validity domain, and currents up to one width of their range beyond it."""
    domain = model.validity
    width = domain.current_max_A - domain.current_min_A
    lower, upper = np.full(order, -np.inf), np.full(order, np.inf)
    lower[0], upper[0] = NEAREST * domain.distance_min_m, FARTHEST * domain.distance_max_m
    lower[2], upper[2] = domain.current_min_A - width, domain.current_max_A + width
    return lower, upper
