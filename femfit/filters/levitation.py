"""The filter's view of a levitating magnet, built from the actuator model.

States are distance (m), velocity (m/s) and current (A), those that the model's effects add (lag, hysteresis), and, for
a Hall element whose quiescent voltage drifts, its bias (V) as a random walk. A step is one of Euler's, as in (33). The
measurement is the Hall voltage through the fitted field, which lets the filter itself tell the coil's part from the
magnet's.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (32) and (33), as corrected in femfit.model.dynamics.
"""

from functools import partial

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
from femfit.filters.process import FilterProcess
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import euler_jacobian, euler_step, hall_voltage
from femfit.model.float_steps import float_euler_step, float_hall_voltage

LARGEST_STEP = 2.0
"""Largest stable step of Euler's method times R/L of a decaying current (E. Hairer and G. Wanner, Solving Ordinary
Differential Equations II (Springer, 1996), section IV.2)."""

STATE_NAMES = ("distance_m", "velocity_m_s", "current_A", "hall_bias_V")


def levitation_process(
    model: ActuatorModel,
    *,
    hall_bias: bool = False,
    noise: FilterNoise | None = None,
    distance: float | None = None,
) -> FilterProcess:
    """Process and measurement of a hanging magnet with a Hall element.

    The Jacobians are analytic, and central differences where effects have states.

    Parameters
    ----------
    hall_bias : bool
        Add the Hall bias in V as the last state.
    noise : FilterNoise or None
        Derived by :func:`default_noise` where None.
    distance : float or None
        Operating point in m where noise and inductance are taken; from the model's reference where None.
    """
    model.require_dynamics()
    distance = operating_distance(model) if distance is None else distance
    require_slow_coil(model, distance)
    noise = default_noise(model, distance) if noise is None else noise
    by_differences = model.memory_names or (model.dynamics is not None and model.dynamics.late)
    names = (*STATE_NAMES[:3], *model.memory_names, *(STATE_NAMES[3:] if hall_bias else ()))
    lower, upper = _plausible_range(model, len(names))
    return FilterProcess(
        names=names,
        step_s=model.sample_time_s,
        transition=partial(_transition, model),
        measure=partial(_hall_voltage, model),
        process_covariance=process_covariance(model, noise, distance, hall_bias),
        measurement_variance=noise.hall_V**2,
        transition_jacobian=partial(_transition_jacobian, model),
        measurement_jacobian=None if by_differences else partial(_hall_slope, model),
        transition_columns=float_euler_step(model),
        measure_columns=float_hall_voltage(model),
        lower=lower,
        upper=upper,
        start_covariance=with_memory(model, initial_covariance(hall_bias_V=BIAS_DEVIATION_V if hall_bias else None)),
    )


def require_slow_coil(model: ActuatorModel, distance: float) -> None:
    """Refuse a coil whose current one explicit step a sample cannot follow: its error would grow at every sample.

    Parameters
    ----------
    distance : float
        Where the inductance is taken, in m.
    """
    circuit, box = model.require_circuit(), model.validity
    currents = np.linspace(box.current_min_A, box.current_max_A, 5)
    inductance = float(model.magnetics.inductance(np.full(5, distance), currents).min())
    longest = LARGEST_STEP * inductance / circuit.resistance_ohm
    if model.sample_time_s > longest:
        raise FilterError(
            f"The filter of model {model.name!r} must take steps of at most {1e3 * longest:.3g} ms, because its coil "
            f"has L/R = {1e3 * inductance / circuit.resistance_ohm:.3g} ms; the sample time is "
            f"{1e3 * model.sample_time_s:g} ms. Give [supply] a shorter sample_time_ms, or drive the coil by a current "
            "loop with a larger resistance_ohm."
        )


def _transition(model: ActuatorModel, states: FloatArray, voltage: FloatArray) -> FloatArray:
    order = 3 + len(model.memory_names)
    if states.shape[1] == order:
        return euler_step(model, states, voltage, model.sample_time_s)
    result = np.empty(states.shape[::-1]).T
    result[:, :order] = euler_step(model, states[:, :order], voltage, model.sample_time_s)
    result[:, order:] = states[:, order:]
    return result


def _transition_jacobian(model: ActuatorModel, states: FloatArray, voltage: FloatArray) -> FloatArray:
    order, moving = states.shape[1], 3 + len(model.memory_names)
    result = np.zeros((len(states), order, order))
    result[:, :moving, :moving] = euler_jacobian(model, states[:, :moving], voltage, model.sample_time_s)
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


def _plausible_range(model: ActuatorModel, order: int) -> tuple[FloatArray, FloatArray]:
    """Distances around the validity domain, and currents up to one width of their range beyond it."""
    domain = model.validity
    width = domain.current_max_A - domain.current_min_A
    lower, upper = np.full(order, -np.inf), np.full(order, np.inf)
    lower[0], upper[0] = NEAREST * domain.distance_min_m, FARTHEST * domain.distance_max_m
    lower[2], upper[2] = domain.current_min_A - width, domain.current_max_A + width
    return lower, upper
