"""The sensors as the controller sees them: characteristic, delay, noise, clipping, converter, faults.

    reading = rounded(clipped(characteristic(state at t - delay) + offset + drift t + noise))

A sensor with a sample time of its own is read at every so many samples, and not at all (NaN) between them. The state
within a delay that is no whole number of samples is interpolated from its neighbours and their velocities.

Amplitudes of noise over its frequency.

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


@dataclass(frozen=True, eq=False)
class SensorErrors:
    """What is wrong with the sensors; every entry is one number or one a run."""

    noise_scale: FloatArray | float = 1.0  # Of all sensors' noise; shape (runs,)
    # Of the faulty sensor, in the unit of its reading
    faulty: FloatArray | int = 0  # Which sensor, by its place
    offset: FloatArray | float = 0.0  # Constant offset that the model does not know
    drift_per_s: FloatArray | float = 0.0
    stuck_after_s: FloatArray | float = np.inf  # From then on the last reading is repeated; infinite for never
    dropout_probability: FloatArray | float = 0.0  # Probability that a sample reads the lower end of the range
    # The runs are this many equal blocks in a row that share their random numbers, so that what differs between the
    # blocks is not hidden by the noise (common random numbers)
    blocks: int = 1


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
        result[name] = white if white is not None else reading.noise or UNKNOWN_NOISE_PART * span_of(model, name)
    return result


def span_of(model: ActuatorModel, name: str) -> float:
    """Range of a sensor, or of its readings over the validity domain where it has none, in its unit."""
    reading = reading_of(model, name)
    span = reading.high - reading.low
    return span if np.isfinite(span) else readings_span(model, sensor_named(model, name))


class History:
    """The plant's last states, as many as the longest delay asks for; before the first it was at rest."""

    def __init__(self, sensors: Sequence[LoopSensor], first: FloatArray, sample_time_s: float) -> None:
        longest = max((sensor.delay for sensor in sensors), default=0.0)
        self._states = deque([first], maxlen=floor(longest) + 3)  # a pickup coil's reading is of two samples
        self._step = sample_time_s

    def add(self, state: FloatArray) -> None:
        """The state one sample later."""
        self._states.append(state)

    def before(self, samples: float) -> FloatArray:
        """The state so many samples before the last one."""
        steps = floor(samples)
        fraction = samples - steps
        states = self._states
        later = states[max(-1 - steps, -len(states))]
        if fraction == 0.0:
            return later
        return between(states[max(-2 - steps, -len(states))], later, 1.0 - fraction, self._step)


def between(earlier: FloatArray, later: FloatArray, fraction: float, step: float) -> FloatArray:
    """A state between two that are a step in s apart: the distance by Hermite's cubic, the rest linearly.

    Parameters
    ----------
    fraction : float
        Of the step that has passed since the earlier one, 0 to 1.
    """
    state = earlier + fraction * (later - earlier)
    s, rest = fraction, 1.0 - fraction
    state[..., 0] = (
        (1.0 + 2.0 * s) * rest**2 * earlier[..., 0]
        + s**2 * (1.0 + 2.0 * rest) * later[..., 0]
        + step * s * rest * (rest * earlier[..., 1] - s * later[..., 1])
    )
    return state


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
) -> FloatArray:
    """Take the readings of one sample.

    Parameters
    ----------
    last, values : array, shape (runs, sensors)
        The readings before, and what the sensors would read without these errors.
    sample : int
        Number of the sample; a slow sensor is not read at each.

    Returns
    -------
    array, shape (runs, sensors)
        NaN for a sensor that is not read at this sample.
    """
    result, drawn = np.empty_like(values), len(values) // errors.blocks
    for k, sensor in enumerate(sensors):
        # Always both, so that switching one error on leaves the other's random numbers as they were
        white, lost = random.standard_normal(drawn), random.random(drawn)
        if sample % sensor.period:
            result[:, k] = np.nan
            continue
        if errors.blocks > 1:
            white, lost = np.tile(white, errors.blocks), np.tile(lost, errors.blocks)
        mine = np.asarray(errors.faulty) == k
        off = np.where(mine, errors.offset + np.multiply(errors.drift_per_s, time), 0.0)
        reading = convert(sensor, values[:, k] + off + errors.noise_scale * sensor.reading.noise * white)
        low = sensor.reading.low if np.isfinite(sensor.reading.low) else np.nan
        dropped = mine & (lost < errors.dropout_probability) & (sample >= 0)  # the support comes before the faults
        reading = np.where(dropped, low, reading)
        stuck = mine & np.asarray(time >= errors.stuck_after_s) & np.isfinite(last[:, k])
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


def amplitude_spectrum(distance: FloatArray) -> FloatArray:
    """One-sided amplitudes |X_k| 2 / sum(window) of Hann-windowed records of shape (samples, runs) without their means.

    Root mean square over the runs (F. J. Harris, Proc. IEEE 66 (1978) 51: windows).
    """
    window = np.hanning(len(distance))[:, None]
    transform = np.abs(np.fft.rfft(window * (distance - distance.mean(axis=0)), axis=0)) * 2.0 / window.sum()
    return np.asarray(np.sqrt(np.mean(transform**2, axis=1)))
