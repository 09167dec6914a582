"""The simulated actuator: the model's own equations and drivers, with a wrong force on request, and its sensors.

A body that comes to a stop of its drawing bounces, or stays there until a force takes it away. Its steps are those of
:mod:`femfit.model.sample_step`. The sensors are as the controller sees them: characteristic, delay, noise, clipping,
converter, faults.

    reading = rounded(clipped(characteristic(state at t - delay) + offset + drift t + noise))

A sensor with a sample time of its own is read at every so many samples, and not at all (NaN) between them. What a
sensor reads within a delay that is no whole number of samples lies on a line between its neighbours, as a filter takes
it.

References
----------
B. Widrow and I. Kollar, Quantization Noise (Cambridge University Press, 2008): error variance LSB^2/12.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from casadi import SX

from femfit.core.errors import DomainError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.public import require_known
from femfit.core.text import amount
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import Magnetics
from femfit.model.sensing import AnySensor
from femfit.model.sensors import (
    WHOLE,
    Reading,
    reading_of,
    readings_span,
    sample_weights,
    sampled_value,
    sensor_named,
)
from femfit.simulation.constants import UNKNOWN_NOISE_PART

LEAST_STEPS = 4
"""Chosen: steps of a plant in a sample, however short that is."""


@dataclass(frozen=True, eq=False)
class ScaledForce(Magnetics):
    """Magnetics whose force and motional constant are scaled, the inductance left alone.

    W'(d, i) = s (W'_0(d, i) - W'_0(d_ref, i)) + W'_0(d_ref, i): the plant stays conservative, and at d_ref the flux
    linkage is unchanged as well.
    """

    base: Magnetics
    scale: float  # s
    reference_distance_m: float

    def with_memory(self, memory: Mapping[str, SX]) -> Callable[[SX, SX], SX]:
        """W' of an expression's distance and currents where the states of effects are these."""
        inner = self.base.with_memory(memory)

        def coenergy(distance: SX, currents: SX) -> SX:
            held = inner(SX(self.reference_distance_m), currents)
            return self.scale * (inner(distance, currents) - held) + held

        return coenergy

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and currents."""
        return self.with_memory({})(distance, currents)


@dataclass(frozen=True, eq=False)
class Plant:
    """A batch of simulated actuators with their drivers."""

    model: ActuatorModel

    @property
    def steps(self) -> int:
        """Steps in a sample: twice as many as a filter's, so that a loop sees what its filter's steps are off by."""
        return max(LEAST_STEPS, 2 * self.model.sample_step.count)

    def start(self, state: FloatArray) -> FloatArray:
        """The first state from (distance, velocity, currents), shape (runs, 2 + n); all others are at rest."""
        added = self.model.order - state.shape[1]
        return np.concatenate([np.array(state, dtype=np.float64), np.zeros((len(state), added))], axis=1)

    def step(self, state: FloatArray, command: FloatArray, touched: BoolArray | None = None) -> FloatArray:
        """Advance by one sample period.

        Parameters
        ----------
        state : array, shape (runs, 2 + n or more)
            Distance in m, velocity in m/s, currents in A; after them the other ``model.state_names``.
        command : array, shape (runs, n), or (runs,) with one circuit
            Held over the period, in V, or in A for a current amplifier.
        touched : array, shape (2, runs), or None
            Is made true where a body meets its near stop, or its far one.
        """
        ends, n = self.model.require_motion().ends, len(self.model.circuits)
        commands = np.broadcast_to(command[:, None] if command.ndim == 1 else command, (len(state), n))
        step = self.model.sample_step.function(self.model.sample_time_s / self.steps)
        for _ in range(self.steps):
            moved = step(state.T, commands.T).T
            state, way = moved[:, :-1], moved[:, -1]
            if touched is not None:
                touched |= [way < ends[0], way > ends[1]]
        return state


def with_force_scale(model: ActuatorModel, scale: float) -> ActuatorModel:
    """The model with its force scaled, 1.01 for one per cent more: a plant that the model describes wrongly."""
    middle = 0.5 * (model.validity.distance_min_m + model.validity.distance_max_m)
    return replace(model, magnetics=ScaledForce(model.magnetics, scale, middle))


@dataclass(frozen=True)
class LoopSensor:
    """One sensor of a loop."""

    reading: Reading
    sensor: AnySensor
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


def loop_sensors(model: ActuatorModel, noise: Mapping[str, float], sample_time_s: float) -> tuple[LoopSensor, ...]:
    """The sensors of a model as a loop with this sample time reads them; a faster sensor at each of its samples.

    Parameters
    ----------
    noise : mapping of str to float
        White noise of one sample by the names of the sensors that are read, in their units.

    Raises
    ------
    DomainError
        If a slower sensor's sample time is no multiple of the loop's.
    """
    read = []
    for name, white in noise.items():
        reading = replace(reading_of(model, name), noise=white)
        samples = (reading.sample_time_s or sample_time_s) / sample_time_s
        period = reading.period(sample_time_s)
        if samples > 1.0 + WHOLE and abs(samples - period) > WHOLE * samples:
            raise DomainError(
                f"A sensor must be read at whole samples of the controller; sensor {name} is read every "
                f"{amount(samples * sample_time_s, 's', 3)} and the controller's sample is "
                f"{amount(sample_time_s, 's', 3)}. Make [sensors.{name}] sample_time_ms a multiple of it."
            )
        read.append(LoopSensor(reading, sensor_named(model, name), period))
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
    by_name = noise if isinstance(noise, Mapping) else {} if noise is None else {names[0]: noise}
    require_known("The noise's sensor", by_name, names)
    result = {}
    for name in names:
        reading = reading_of(model, name)
        span = reading.high - reading.low
        span = span if np.isfinite(span) else readings_span(model, sensor_named(model, name))
        result[name] = white = by_name.get(name, reading.noise or UNKNOWN_NOISE_PART * span)
        if not 0.0 <= white < np.inf:
            raise DomainError(
                f"The noise of a sample must be >= 0 {reading.unit}; instead received {white:g} {reading.unit} of "
                f"{name}. Leave it out for the model's."
            )
    return result


class SensorBank:
    """Readings of a batch of runs, sample after sample; before the first state the bodies were at rest there.

    ``alike`` equal parts of the runs meet the same noise.
    """

    def __init__(
        self,
        model: ActuatorModel,
        sensors: Sequence[LoopSensor],
        errors: SensorErrors,
        state: FloatArray,
        random: np.random.Generator,
        alike: int = 1,
    ) -> None:
        self.model, self.sensors, self.errors, self.random, self.alike = model, sensors, errors, random, alike
        self._faulty = errors.faulty or sensors[0].name
        self._weights = [sample_weights(each.sensor, model.sample_time_s) for each in sensors]
        self._values = [deque[FloatArray](maxlen=len(weights)) for weights in self._weights]
        self._last = np.full((len(state), len(sensors)), np.nan)
        for _ in range(max(map(len, self._weights))):
            self.see(state, 0.0)

    def see(self, state: FloatArray, time: float) -> None:
        """The plant's state at the next sample, shape (runs, n)."""
        for sensor, values in zip(self.sensors, self._values, strict=True):
            values.appendleft(sampled_value(self.model, sensor.sensor, state, time))

    @property
    def exact(self) -> FloatArray:
        """What the sensors would read without noise, clipping and rounding, of shape (runs, sensors)."""
        pairs = zip(self._weights, self._values, strict=True)
        return np.stack([weights @ np.array(values) for weights, values in pairs], axis=1)

    def read(self, sample: int, time: float) -> FloatArray:
        """Readings of shape (runs, sensors); NaN for a sensor that is not read at this sample, by its number."""
        exact, errors, random = self.exact, self.errors, self.random
        result = np.full_like(exact, np.nan)
        for k, sensor in enumerate(self.sensors):
            # Always both, so that switching one error on leaves the other's random numbers as they were
            share = len(exact) // self.alike
            white, lost = (np.tile(draw(share), self.alike) for draw in (random.standard_normal, random.random))
            if sample % sensor.period:
                continue
            faulty = sensor.name == self._faulty
            off = errors.offset + errors.drift_per_s * time if faulty else 0.0
            result[:, k] = reading = convert(sensor, exact[:, k] + off + sensor.reading.noise * white)
            if faulty:
                low = sensor.reading.low if np.isfinite(sensor.reading.low) else np.nan
                dropped = (lost < errors.dropout_probability) & (sample >= 0)  # the support comes before the faults
                stuck = (time >= errors.stuck_after_s) & np.isfinite(self._last[:, k])
                result[:, k] = np.where(stuck, self._last[:, k], np.where(dropped, low, reading))
        self._last = np.where(np.isnan(result), self._last, result)
        return result


def convert(sensor: LoopSensor, values: FloatArray) -> FloatArray:
    """Clip to the reading's range and round to the converter's steps."""
    reading = sensor.reading
    clipped = np.clip(values, reading.low, reading.high)
    if not reading.step:
        return np.asarray(clipped)
    codes = np.minimum(np.round((clipped - reading.low) / reading.step), 2.0**reading.bits - 1.0)
    return np.asarray(reading.low + reading.step * codes)
