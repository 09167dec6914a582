"""Sensors by name, and what their samples are made of: the values of a few states at this sample and at earlier ones.

reading_k = sum over j of c_j g(x_(k-j)). For a sensor that is late by a part of a sample, g is interpolated between two
samples. A pickup coil's g is its flux linkage, and its reading the mean voltage over the sample.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import floor

import numpy as np

from femfit.core.errors import MissingPartError
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import circuit_currents
from femfit.device.electrics import CurrentSensor, PositionSensor
from femfit.device.keys import UNITS
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import evaluated
from femfit.model.hall import HallSensor, OtherSensor, PickupSensor
from femfit.model.sensing import AnySensor, current_index, pickup_flux, reading_expression

HALL = "hall"
"""Name of the Hall element of a model."""


@dataclass(frozen=True)
class Reading:
    """What a sensor's samples are."""

    name: str
    unit: str
    column: str | None  # Of a record; None where records have no column of this kind
    noise: float  # White noise of one sample before the converter, as a standard deviation
    low: float  # Ends of the range; infinite where there are none
    high: float
    bits: int  # Resolution of the converter over that range; 0 for none
    delay_s: float = 0.0
    sample_time_s: float | None = None

    @property
    def step(self) -> float:
        """One step of the converter; 0 where there is none."""
        span = self.high - self.low
        return span / 2.0**self.bits if self.bits and np.isfinite(span) else 0.0

    @property
    def inner(self) -> tuple[float, float]:
        """Between these a reading tells something; one at an end of the range does not."""
        slack = 1e-9 * (self.high - self.low) if np.isfinite(self.high - self.low) else 0.0
        return self.low + slack, self.high - slack

    @property
    def rounding(self) -> float:
        """Standard deviation of the converter's rounding, LSB / sqrt(12)."""
        return self.step / float(np.sqrt(12.0))

    @property
    def white(self) -> float:
        """Standard deviation of one sample, the rounding included."""
        return float(np.hypot(self.noise, self.rounding))

    def period(self, step_s: float) -> int:
        """Samples of ``step_s`` from one reading to the next, to the nearest; 1 where it is read at each."""
        return 1 if self.sample_time_s is None else max(1, round(self.sample_time_s / step_s))


def sensors_of(model: ActuatorModel) -> dict[str, AnySensor]:
    """All sensors by name, the Hall element first."""
    hall = {} if model.sensor is None else {HALL: model.sensor}
    return hall | {sensor.name: sensor for sensor in model.other_sensors}


def sensor_named(model: ActuatorModel, name: str) -> AnySensor:
    """One sensor, or :class:`MissingPartError` with what there is."""
    sensors = sensors_of(model)
    if name not in sensors:
        has = f"it has {', '.join(sensors)}" if sensors else "it has none"
        raise MissingPartError(
            f"Model {model.name!r} must have a sensor named {name!r}; {has}. Name one of them, or add [sensors.{name}] "
            "to the actuator file and fit again."
        )
    return sensors[name]


def names_or_kinds(model: ActuatorModel, sensors: Sequence[str]) -> tuple[str, ...]:
    """Names of sensors as given; for one that no sensor bears, those of all sensors of that kind, as ``current``."""
    by_name, names = sensors_of(model), []
    for name in sensors:
        of_kind = [label for label, sensor in by_name.items() if getattr(sensor, "kind", HALL) == name]
        names += [name] if name in by_name or not of_kind else of_kind
    return tuple(dict.fromkeys(names))


def reading_of(model: ActuatorModel, name: str) -> Reading:
    """Unit, column, noise, range and timing of a sensor of a model."""
    sensor = sensor_named(model, name)
    if isinstance(sensor, HallSensor):
        ends, timing = (sensor.output_min_V, sensor.output_max_V), (sensor.delay_s, sensor.sample_time_s)
        return Reading(name, "V", "hall_V", sensor.noise_V, *ends, sensor.adc_bits, *timing)
    low = -np.inf if sensor.minimum is None else sensor.minimum
    high = np.inf if sensor.maximum is None else sensor.maximum
    _, unit, _ = quantity = _quantity(model, sensor)
    column: str | None = "distance_m" if unit == "m" else sensor.COLUMN or None
    if [_quantity(model, each) for each in model.other_sensors].count(quantity) > 1:
        column = None  # which several sensors would share
    elif isinstance(sensor, CurrentSensor):
        column = circuit_currents(model.circuit_names)[current_index(model, sensor) - 2]
    return Reading(name, unit, column, sensor.noise, low, high, sensor.bits, sensor.delay_s, sensor.sample_time_s)


def _quantity(model: ActuatorModel, sensor: OtherSensor) -> tuple[str, str, str]:
    """What a sensor reads, in which unit, and of which of several circuits."""
    circuit = sensor.circuit if isinstance(sensor, CurrentSensor) and len(model.circuits) > 1 else ""
    unit = sensor.unit if isinstance(sensor, PositionSensor) else UNITS[sensor.UNIT].printed.replace("²", "^2")
    return sensor.kind, unit, circuit


def unit_in_name(unit: str) -> str:
    """A unit as the name of a state ends in it: m_per_s2 of m/s^2."""
    return unit.replace("/", "_per_").replace("^", "")


def predict_sensor(
    model: ActuatorModel,
    sensor: AnySensor,
    state: FloatArray,
    time: FloatArray | float = 0.0,
    voltage: FloatArray | None = None,
) -> FloatArray:
    """Reading of a sensor at an instant, of shape (...), without delay, noise, clipping and rounding.

    Its unit is that of :func:`reading_of`.

    Parameters
    ----------
    state : array, shape (..., n)
        Distance, velocity, current and the states of effects, as in :mod:`femfit.model.dynamics`.
    time : array or float
        Since the start in s; matters to drifts alone.
    voltage : array or None
        Across the circuits, as of :func:`femfit.model.dynamics.state_derivative`; it reaches pickup coils alone. What
        holds the currents where None.
    """
    if voltage is None:
        holding = model.resistances_ohm * model.currents_of(state)
        voltage = holding[..., 0] if len(model.circuits) == 1 else holding
    equations, key = model.equations, ("reading", sensor)
    read = equations.function(key, lambda x, u, _, time, *__: reading_expression(equations, sensor, x, u, time))
    return evaluated(model, read, state, voltage, time=time)[..., 0]


WHOLE = 1e-6
"""Numerical: a delay this near to a whole number of samples is one."""

SAMPLES_OF_A_STROKE = 100.0
"""Assumed: samples in which a body goes through its stroke, where a speed must be guessed."""


def sample_weights(sensor: AnySensor, step_s: float) -> FloatArray:
    """c_0, c_1, .. of a sensor that is sampled with a step in s; the last is not zero."""
    delay = sensor.delay_s / step_s
    samples = floor(delay + WHOLE)
    fraction = max(0.0, delay - samples)
    fraction = 0.0 if fraction < WHOLE else fraction
    weights = np.zeros(samples + 2)
    weights[samples], weights[samples + 1] = 1.0 - fraction, fraction
    weights = weights[: samples + 1] if fraction == 0.0 else weights
    return np.convolve(weights, [1.0 / step_s, -1.0 / step_s]) if isinstance(sensor, PickupSensor) else weights


def sampled_value(
    model: ActuatorModel, sensor: AnySensor, state: FloatArray, time: FloatArray | float = 0.0
) -> FloatArray:
    """What samples are made of, g, of shape (...): a flux linkage in Wb, or what the sensor reads without its delay."""
    if not isinstance(sensor, PickupSensor):
        return predict_sensor(model, sensor, state, time)
    flux = model.equations.function(("flux", sensor), lambda x, *_: pickup_flux(model, sensor, x))
    return evaluated(model, flux, state)[..., 0]


def sampled_readings(model: ActuatorModel, sensor: AnySensor, states: FloatArray) -> FloatArray:
    """Readings without noise along states of shape (samples, n); before the first it was as at the first."""
    values, row = sampled_value(model, sensor, states), np.arange(len(states))
    weights = enumerate(sample_weights(sensor, model.sample_time_s))
    return np.asarray(np.sum([weight * values[np.maximum(row - k, 0)] for k, weight in weights], axis=0))


def readings_span(model: ActuatorModel, sensor: AnySensor) -> float:
    """Width of the readings over the validity domain, in the sensor's unit; of a body at a usual speed in a coil."""
    distance, currents = model.validity.grid(9, 9, several=3)
    states, n = np.zeros((distance.size, model.order)), len(model.circuits)
    states[:, 0], states[:, 2 : 2 + n] = distance, currents[:, :n]
    span = float(np.ptp(sampled_value(model, sensor, states)))
    return span / (SAMPLES_OF_A_STROKE * model.sample_time_s) if isinstance(sensor, PickupSensor) else span
