"""The sensors as the controller sees them: characteristic, delay, noise, clipping, converter, faults.

    reading = rounded(clipped(characteristic(state at t - delay) + offset + drift t + noise))

A sensor with a sample time of its own is read at every so many samples, and not at all (NaN) between them. The state
within a delay that is no whole number of samples lies on a line between its neighbours, as a filter takes it.

References
----------
B. Widrow and I. Kollar, Quantization Noise (Cambridge University Press, 2008): error variance LSB^2/12.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import floor

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.core.text import amount
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import PickupSensor
from femfit.model.sensing import AnySensor
from femfit.model.sensors import WHOLE, Reading, reading_of, readings_span, sampled_value, sensor_named
from femfit.simulation.constants import UNKNOWN_NOISE_PART


@dataclass(frozen=True)
class LoopSensor:
    """One sensor of a loop."""

    reading: Reading
    sensor: AnySensor
    delay: float  # In samples
    period: int  # Samples from one reading to the next

    @property
    def name(self) -> str:
        """The sensor's."""
        return self.reading.name


@dataclass(frozen=True, kw_only=True)
class SensorErrors:
    """What is wrong with one sensor, in the unit of its reading."""

    faulty: str | None = None  # Name of the sensor; None: the first
    offset: float = 0.0  # Constant offset that the model does not know
    drift_per_s: float = 0.0
    stuck_after_s: float = np.inf  # From then on the last reading is repeated; infinite for never
    dropout_probability: float = 0.0  # Probability that a sample reads the lower end of the range


def loop_sensors(
    model: ActuatorModel, names: Sequence[str], noise: Mapping[str, float], sample_time_s: float
) -> tuple[LoopSensor, ...]:
    """The named sensors of a model as a loop with this sample time reads them; a faster sensor at each of its samples.

    Raises
    ------
    DomainError
        If a slower sensor's sample time is no multiple of the loop's.
    """
    read = []
    for name in names:
        sensor = sensor_named(model, name)
        reading = replace(reading_of(model, name), noise=noise[name])
        samples = (reading.sample_time_s or sample_time_s) / sample_time_s
        period = reading.period(sample_time_s)
        if samples > 1.0 + WHOLE and abs(samples - period) > WHOLE * samples:
            raise DomainError(
                f"A sensor must be read at whole samples of the controller; sensor {name} is read every "
                f"{amount(samples * sample_time_s, 's', 3)} and the controller's sample is "
                f"{amount(sample_time_s, 's', 3)}. Make [sensors.{name}] sample_time_ms a multiple of it."
            )
        read.append(LoopSensor(reading, sensor, reading.delay_s / sample_time_s, period))
    return tuple(read)


def sensor_noise(
    model: ActuatorModel, names: Sequence[str], noise: Mapping[str, float] | float | None = None
) -> dict[str, float]:
    """White noise of one sample of each sensor: as given, the sensor's own, or a part of its range where it has none.

    Parameters
    ----------
    noise : mapping of str to float, float or None
        By the sensors' names, in the units of their readings; one number is the first sensor's.
    """
    by_name = dict(noise) if isinstance(noise, Mapping) else {} if noise is None else {names[0]: noise}
    if unknown := [name for name in by_name if name not in names]:
        raise DomainError(
            f"Noise must be given for sensors that the loop reads ({', '.join(names)}); instead received "
            f"{', '.join(unknown)}."
        )
    result = {}
    for name in names:
        reading, white = reading_of(model, name), by_name.get(name)
        if white is not None and not 0.0 <= white < np.inf:
            raise DomainError(
                f"The noise of a sample must be >= 0 {reading.unit}; instead received {white:g} {reading.unit} of "
                f"{name}. Leave it out for the model's."
            )
        span = reading.high - reading.low
        span = span if np.isfinite(span) else readings_span(model, sensor_named(model, name))
        result[name] = white if white is not None else reading.noise or UNKNOWN_NOISE_PART * span
    return result


class History:
    """The plant's last states, as many as the longest delay asks for; before the first it was at rest."""

    def __init__(self, sensors: Sequence[LoopSensor], first: FloatArray) -> None:
        longest = max((sensor.delay for sensor in sensors), default=0.0)
        self._states = deque([first], maxlen=floor(longest) + 3)  # a pickup coil's reading is of two samples

    def add(self, state: FloatArray) -> None:
        """The state one sample later."""
        self._states.append(state)

    def before(self, samples: float) -> FloatArray:
        """The state so many samples before the last one."""
        steps = floor(samples)
        fraction = samples - steps
        states = self._states
        later = states[max(-1 - steps, -len(states))]
        earlier = states[max(-2 - steps, -len(states))]
        return later + fraction * (earlier - later)


def true_readings(
    model: ActuatorModel, sensors: Sequence[LoopSensor], history: History, time: FloatArray | float = 0.0
) -> FloatArray:
    """What the sensors would read without noise, clipping and rounding, of shape (runs, sensors)."""
    columns = []
    for sensor in sensors:
        value = sampled_value(model, sensor.sensor, history.before(sensor.delay), time)
        if isinstance(sensor.sensor, PickupSensor):
            before = sampled_value(model, sensor.sensor, history.before(sensor.delay + 1.0), time)
            value = (value - before) / model.sample_time_s
        columns.append(value)
    return np.stack(columns, axis=1)


def read_sensors(
    sensors: Sequence[LoopSensor],
    errors: SensorErrors,
    last: FloatArray,
    values: FloatArray,
    sample: int,
    time: float,
    random: np.random.Generator,
    alike: int = 1,
) -> FloatArray:
    """Take the readings of one sample.

    Parameters
    ----------
    last, values : array, shape (runs, sensors)
        The readings before, and what the sensors would read without these errors.
    sample : int
        Number of the sample; a slow sensor is not read at each.
    alike : int
        Equal parts of the runs that meet the same noise.

    Returns
    -------
    array, shape (runs, sensors)
        NaN for a sensor that is not read at this sample.
    """
    result, runs, faulty = np.empty_like(values), len(values), errors.faulty or sensors[0].name
    for k, sensor in enumerate(sensors):
        # Always both, so that switching one error on leaves the other's random numbers as they were
        white, lost = (
            np.concatenate([draw(runs // alike)] * alike) for draw in (random.standard_normal, random.random)
        )
        if sample % sensor.period:
            result[:, k] = np.nan
            continue
        off = errors.offset + errors.drift_per_s * time if sensor.name == faulty else 0.0
        reading = convert(sensor, values[:, k] + off + sensor.reading.noise * white)
        if sensor.name != faulty:
            result[:, k] = reading
            continue
        low = sensor.reading.low if np.isfinite(sensor.reading.low) else np.nan
        dropped = (lost < errors.dropout_probability) & (sample >= 0)  # the support comes before the faults
        reading = np.where(dropped, low, reading)
        stuck = (time >= errors.stuck_after_s) & np.isfinite(last[:, k])
        result[:, k] = np.where(stuck, last[:, k], reading)
    return result


def convert(sensor: LoopSensor, values: FloatArray) -> FloatArray:
    """Clip to the reading's range and round to the converter's steps."""
    reading = sensor.reading
    clipped = np.clip(values, reading.low, reading.high)
    if not reading.step:
        return np.asarray(clipped)
    codes = np.minimum(np.round((clipped - reading.low) / reading.step), 2.0**reading.bits - 1.0)
    return np.asarray(reading.low + reading.step * codes)
