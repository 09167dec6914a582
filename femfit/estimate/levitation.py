"""The filter's view of an actuator's moving part, built from its model.

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

import numpy as np
from scipy.linalg import block_diag

from femfit.core.errors import FilterError
from femfit.core.numerics import FloatArray
from femfit.estimate.constants import (
    BIAS_DEVIATION_V,
    BIAS_SHARE,
    BIAS_SHARE_PER_ROOT_S,
    DELAYED_NOISE,
    FAR_OFF,
    FARTHEST,
    NEAREST,
)
from femfit.estimate.noise import FilterNoise, default_noise, first_deviations, operating_distance, process_covariance
from femfit.estimate.process import FilterProcess, Output
from femfit.estimate.process_graph import process_graph
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import commands_currents
from femfit.model.hall import HallSensor
from femfit.model.sensors import HALL, reading_of, readings_span, sensor_named, sensors_of


def levitation_process(
    model: ActuatorModel,
    *,
    hall_bias: bool = False,
    noise: FilterNoise | None = None,
    distance: float | None = None,
    sensors: Sequence[str] | None = None,
    biases: Sequence[str] | None = None,
    commanded: bool = False,
) -> FilterProcess:
    """Process and measurement of a moving part with any circuits and sensors.

    The Jacobians are exact; of a model whose step has very many operations, they are central differences.

    Parameters
    ----------
    hall_bias : bool
        Add the Hall bias in V as the last state; short for ``biases=("hall",)``.
    noise : FilterNoise or None
        Derived by :func:`default_noise` where None.
    distance : float or None
        Operating point in m where noise and inductance are taken; from the model's reference where None.
    sensors : sequence of str or None
        Names of the sensors, in the order of a measurement's entries; the Hall element, or all where there is none.
    biases : sequence of str or None
        Which of them have a bias that is estimated.
    commanded : bool
        Whether the inputs are what the drivers are told, in V or A, instead of the voltages across the circuits: a
        freewheel diode and a current amplifier then have their say.
    """
    model.require_dynamics()
    sensors = chosen_sensors(model, sensors)
    graph = process_graph(model, sensors, chosen_biases(sensors, biases, hall_bias))
    distance = operating_distance(model) if distance is None else distance
    noise = default_noise(model, distance) if noise is None else noise
    outputs = tuple(_output(model, name, noise) for name in sensors)
    first, walks = [], []  # standard deviations of biases, and their random walks over sqrt(s)
    for name in graph.biases:
        span = 0.0 if name == HALL else readings_span(model, sensor_named(model, name))
        first.append(BIAS_DEVIATION_V if name == HALL else BIAS_SHARE * span)
        walks.append(noise.bias_density if name == HALL else BIAS_SHARE_PER_ROOT_S * span)
    deviations = np.append(first_deviations(model), first)
    # Bodies held still all over the validity domain
    distances, currents = model.validity.grid(5, 3)
    places, n = np.zeros((distances.size, graph.base)), len(model.circuits)
    places[:, 0], places[:, 2 : 2 + n] = distances, currents[:, :n]
    remembered = graph.sample_spreads(places, deviations)
    covariance = process_covariance(model, noise, distance, walks)
    # A step adds to remembered values far less than what the readings' noise would make of them
    variance = {output.name: output.variance for output in outputs}
    added = [
        np.full(samples.count, DELAYED_NOISE**2 * variance[samples.name] / np.abs(samples.weights).max() ** 2)
        for samples in graph.samples
    ]
    lower, upper = _plausible_range(model, deviations, graph.order)
    return FilterProcess(
        model,
        graph.biases,
        graph.samples,
        driven=commanded and bool(model.diodes or commands_currents(model).any()),
        outputs=outputs,
        process_covariance=block_diag(covariance, np.diag(np.concatenate([*added, np.zeros(0)]))),
        lower=lower,
        upper=upper,
        start_covariance=np.diag(np.square(np.append(deviations, remembered))),
    )


def _output(model: ActuatorModel, name: str, noise: FilterNoise) -> Output:
    """A sensor of the model as a filter sees it."""
    reading = reading_of(model, name)
    hall = isinstance(sensor_named(model, name), HallSensor)
    white = noise.hall_V if hall else noise.sensors.get(name, reading.white)
    if not white > 0.0:
        raise FilterError(
            f"A filter must know the noise of sensor {name!r}, and it must be > 0 {reading.unit}; it is {white:g}. "
            f"Give [sensors.{name}] its noise in the actuator file, or take it from a record: femfit observe."
        )
    return Output(name, reading.unit, white**2, reading.period(model.sample_time_s))


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
    lower, upper = np.full(order, -np.inf), np.full(order, np.inf)
    stroke = domain.distance_max_m - domain.distance_min_m
    # Beyond a face that the body passes there are distances of both signs
    lower[0] = NEAREST * domain.distance_min_m if domain.distance_min_m > 0.0 else domain.distance_min_m - stroke
    upper[0] = FARTHEST * domain.distance_max_m if domain.distance_min_m > 0.0 else domain.distance_max_m + stroke
    upper[1] = (upper[0] - lower[0]) / model.sample_time_s
    lower[1] = -upper[1]
    for k, (low, high) in enumerate(domain.current_limits_A[: len(model.circuits)], start=2):
        lower[k], upper[k] = low - (high - low), high + (high - low)
    upper[first : len(deviations)] = FAR_OFF * deviations[first:]
    lower[first:] = -upper[first:]
    return lower, upper
