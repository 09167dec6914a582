"""A Kalman filter for a model, ready to start: its view of an actuator's moving part, built from the model.

States are distance (m), velocity (m/s) and current (A), those that the model's effects add (lag, hysteresis), and, for
sensors that drift, their biases as random walks. A step is that of :mod:`femfit.model.equations` in place of
Euler's in (33): a coil may be as fast as it likes. At a stop the body comes to rest. The measurement is the vector of
the readings: a Hall voltage through the fitted field, which lets the filter itself tell the coil's part from the
magnet's, a current, a distance, an acceleration, a force.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (32) and (33), as corrected in femfit.model.dynamics.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import casadi as ca
import numpy as np
from casadi import SX
from scipy.linalg import block_diag

from femfit.core.errors import FilterError
from femfit.core.graph import GraphFunction, building
from femfit.core.numerics import LARGEST, FloatArray
from femfit.estimate.filter import Filter
from femfit.estimate.moments import ExtendedFilter, UnscentedFilter
from femfit.estimate.noise import FilterNoise, default_noise, first_deviations, operating_distance, process_covariance
from femfit.estimate.process import FilterProcess, Output, sampled
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import commands_currents
from femfit.model.hall import HallSensor
from femfit.model.json_file import model_of
from femfit.model.sensors import HALL, reading_of, readings_span, sample_weights, sensor_named, sensors_of

BIAS_DEVIATION_V = 0.02
"""Conventional: first standard deviation of the Hall offset; the data sheet of a ratiometric linear element allows at
most +-75 mV (Allegro A1321: quiescent output 2.425 to 2.575 V)."""

BIAS_SHARE, BIAS_SHARE_PER_ROOT_S = 0.01, 5e-4
"""Conventional: first standard deviation of another sensor's bias over the span of its readings in the validity domain,
and the random walk of the bias in a second; the ratio of the two is that of the Hall element's."""

NEAREST, FARTHEST = 0.5, 2.0
"""Conventional: an estimate is lost below half the smallest or above twice the largest distance of the model's validity
domain. The fit's polynomials continue a little outside of it, which a filter needs while it acquires, and mean nothing
further out; a cubic spline that is continued over half a domain is usually off by its own size."""

FAR_OFF = 1e4
"""Conventional: first deviations beyond which an eddy current, an effect's state or a bias is none that a model has."""

MOST_DELAYED_SAMPLES = 100
"""Conventional: samples by which a sensor may be late; each of them is a state of the filter."""

DELAYED_NOISE = 1e-3
"""Numerical: process noise of a remembered value over what its reading's noise makes of it, so that Q is definite."""

FilterKind = Literal["ukf", "ekf"]

_KINDS: dict[str, type[Filter]] = {"ukf": UnscentedFilter, "ekf": ExtendedFilter}


def kalman_filter(
    model: ActuatorModel | str | Path,
    kind: FilterKind = "ukf",
    *,
    sensors: Sequence[str] | None = None,
    biases: Sequence[str] | None = None,
    hall_bias: bool = True,
    noise: FilterNoise | None = None,
    distance: float | None = None,
    first_deviation_m: float | None = None,
    commanded: bool = False,
) -> Filter:
    """A filter of a model, its noise derived from the model and its first covariance chosen.

    Parameters
    ----------
    kind : {'ukf', 'ekf'}
        Unscented or extended.
    sensors : sequence of str or None
        Names of the sensors that it reads, as ``("current", "laser")``, in the order of a measurement's entries; the
        Hall element where None, or all sensors where there is none.
    biases : sequence of str or None
        Sensors whose bias is estimated, each as a state after the others.
    hall_bias : bool
        Estimate the Hall element's offset where ``biases`` is None and it is read.
    noise : FilterNoise or None
        Derived by :func:`femfit.estimate.noise.default_noise` where None.
    distance : float or None
        Operating point in m; the model's first reference distance, or the middle of its range, where None.
    first_deviation_m : float or None
        Standard deviation of the first estimate's distance; 1 mm where None, or less where the way is short.
    commanded : bool
        Whether it is stepped with what the drivers are told, in V or A for a current amplifier, instead of the voltages
        across the circuits.

    Returns
    -------
    Filter
        ``start([distance_m, velocity_m_s, current_A])``, then ``step(state, voltage, readings)`` every sample; a
        reading that is missing is NaN.

    Raises
    ------
    MissingPartError
        If the model lacks circuit, motion, sensor or inductance.
    FilterError
        If the kind is unknown.

    Examples
    --------
    >>> import femfit as ff
    >>> ukf = ff.kalman_filter("model.json")
    >>> ukf.process.names
    ('distance_m', 'velocity_m_s', 'current_A', 'hall_bias_V')
    >>> state = ukf.start([0.022, 0.0, 0.4])
    >>> state = ukf.step(state, 1.1, 2.7)
    >>> state.mean.shape
    (1, 4)
    """
    if kind not in _KINDS:
        raise FilterError(f"The kind of a filter must be one of {', '.join(_KINDS)}; instead received {kind!r}.")
    model = model_of(model)
    model.require_dynamics()
    sensors = chosen_sensors(model, sensors)
    biases = chosen_biases(sensors, biases, hall_bias)
    distance = operating_distance(model) if distance is None else distance
    noise = default_noise(model, distance) if noise is None else noise
    outputs, end = [], model.order + len(biases)
    for name in sensors:
        outputs.append(replace(_output(model, name, noise), first=end))
        end = outputs[-1].places.stop
    spans = [0.0 if name == HALL else readings_span(model, sensor_named(model, name)) for name in biases]
    of_hall = np.array([name == HALL for name in biases], dtype=bool)
    walks = np.where(of_hall, noise.bias_density, BIAS_SHARE_PER_ROOT_S * np.array(spans))
    deviations = np.append(first_deviations(model), np.where(of_hall, BIAS_DEVIATION_V, BIAS_SHARE * np.array(spans)))
    late = [output for output in outputs if len(output.weights) > 1]
    counts = np.array([len(output.weights) - 1 for output in late], dtype=int)
    covariance = process_covariance(model, noise, distance, walks.tolist())
    # A step adds to remembered values far less than what the readings' noise would make of them
    added = [DELAYED_NOISE**2 * output.variance / np.abs(output.weights).max() ** 2 for output in late]
    remembered = np.repeat(_spreads(model, late, deviations), counts)
    lower, upper = _plausible_range(model, deviations, end)
    if first_deviation_m is not None:
        deviations[0] = first_deviation_m
    process = FilterProcess(
        model,
        biases,
        tuple(outputs),
        block_diag(covariance, np.diag(np.repeat(added, counts))),
        np.diag(np.square(np.append(deviations, remembered))),
        lower,
        upper,
        driven=commanded and bool(model.diodes or commands_currents(model).any()),
    )
    return _KINDS[kind](process)


def _output(model: ActuatorModel, name: str, noise: FilterNoise) -> Output:
    """A sensor of the model as a filter sees it.

    Raises
    ------
    FilterError
        If its noise is unknown, or its delay longer than a filter remembers.
    """
    sensor, reading, step = sensor_named(model, name), reading_of(model, name), model.sample_time_s
    if sensor.delay_s > MOST_DELAYED_SAMPLES * step:
        raise FilterError(
            f"A filter remembers {MOST_DELAYED_SAMPLES} samples at most; sensor {name!r} is late by "
            f"{1e3 * sensor.delay_s:g} ms, which are {sensor.delay_s / step:.0f}. Lengthen the "
            "sample time, or leave the sensor out."
        )
    white = noise.hall_V if isinstance(sensor, HallSensor) else noise.sensors.get(name, reading.white)
    if not 0.0 < white < LARGEST:
        raise FilterError(
            f"A filter must know the noise of sensor {name!r}, finite and > 0 {reading.unit}; it is {white:g}. "
            f"Give [sensors.{name}] its noise in the actuator file, or take it from a record: femfit observe."
        )
    weights = tuple(sample_weights(sensor, step).tolist())
    return Output(name, reading.unit, white**2, reading.period(step), weights)


def _spreads(model: ActuatorModel, late: Sequence[Output], deviations: FloatArray) -> FloatArray:
    """The largest deviation of what each late sensor samples, of bodies held still all over the validity domain."""
    if not late:
        return np.zeros(0)
    distances, currents = model.validity.grid(5, 3)
    places, n = np.zeros((len(deviations), distances.size)), len(model.circuits)
    places[0], places[2 : 2 + n] = distances, currents[:, :n].T
    with building():
        x = SX.sym("x", len(deviations))
        slopes = GraphFunction([x], ca.vertcat(*(ca.gradient(sampled(model, each.name, x), x) for each in late)))
    sizes = np.abs(slopes(places)).reshape(len(late), len(deviations), -1)
    return np.asarray(np.einsum("sxp,x->sp", sizes, deviations).max(axis=1))


def chosen_sensors(model: ActuatorModel, sensors: Sequence[str] | None) -> tuple[str, ...]:
    """Names as given, or the Hall element's, or those of all sensors where there is none."""
    if sensors is None:
        names = (HALL,) if model.sensor is not None else tuple(sensors_of(model))
        if not names:
            model.require_sensor()
        return names
    if isinstance(sensors, str) or not sensors or len(set(sensors)) < len(sensors):
        raise FilterError(
            f"sensors must be a sequence of one or more different names; instead received {sensors!r}. "
            f"The model has {', '.join(sensors_of(model)) or 'none'}."
        )
    return tuple(sensors)


def chosen_biases(sensors: Sequence[str], biases: Sequence[str] | None, hall_bias: bool) -> tuple[str, ...]:
    """Names as given, each of them a sensor that is read."""
    if biases is None:
        return (HALL,) if hall_bias and HALL in sensors else ()
    unread = [name for name in biases if name not in sensors]
    if isinstance(biases, str) or unread or len(set(biases)) < len(biases):
        raise FilterError(
            f"biases must be different names out of the sensors that the filter reads ({', '.join(sensors)}); instead "
            f"received {biases!r}. A bias of a sensor that is not read cannot be estimated."
        )
    return tuple(biases)


def _plausible_range(model: ActuatorModel, deviations: FloatArray, order: int) -> tuple[FloatArray, FloatArray]:
    """Distances around the validity domain, passed in no less than a sample; currents a width of their range beyond it.

    Eddy currents, states of effects and biases are :data:`FAR_OFF` first deviations at most.
    """
    domain, first = model.validity, 2 + len(model.circuits)
    low, high = domain.distance_min_m, domain.distance_max_m
    # Beyond a face that the body passes there are distances of both signs
    near, far = (NEAREST * low, FARTHEST * high) if low > 0.0 else (low - (high - low), high + (high - low))
    speed = (far - near) / model.sample_time_s
    ranges = [(near, far), (-speed, speed)]
    ranges += [(least - (most - least), most + (most - least)) for least, most in domain.current_limits_A[: first - 2]]
    ranges += [(-FAR_OFF * deviation, FAR_OFF * deviation) for deviation in deviations[first:]]
    ranges += [(-np.inf, np.inf)] * (order - len(ranges))
    lower, upper = np.array(ranges).T
    return lower, upper
