"""The sensors of a model as a filter sees them: functions of the state, noise, and a bias where one is estimated."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from femfit.core.errors import FilterError
from femfit.core.numerics import FloatArray
from femfit.device.electrics import CurrentSensor, PositionSensor
from femfit.estimate.constants import BIAS_DEVIATION_V, BIAS_SHARE, BIAS_SHARE_PER_ROOT_S
from femfit.estimate.delayed import DelayedSamples, SensorSamples
from femfit.estimate.noise import FilterNoise
from femfit.estimate.process import Measure, Output
from femfit.model.actuator_model import ActuatorModel
from femfit.model.float_steps import float_reading
from femfit.model.hall import HallSensor
from femfit.model.sensed_effects import records_as_it_is
from femfit.model.sensors import (
    HALL,
    AnySensor,
    current_index,
    piece_slope,
    predict_sensor,
    reading_of,
    readings_span,
    sensor_named,
    unit_in_name,
)


def outputs_of(
    model: ActuatorModel,
    sensors: Sequence[str],
    biases: Sequence[str],
    noise: FilterNoise,
    delayed: DelayedSamples | None = None,
) -> tuple[Output, ...]:
    """One output a sensor; a bias is the state at its place in ``biases``, after those of the model."""
    moving = model.order
    outputs = []
    for name in sensors:
        sensor = sensor_named(model, name)
        reading = reading_of(model, name)
        white = noise.hall_V if isinstance(sensor, HallSensor) else noise.sensors.get(name, reading.white)
        if not white > 0.0:
            raise FilterError(
                f"A filter must know the noise of sensor {name!r}, and it must be > 0 {reading.unit}; it is {white:g}. "
                f"Give [sensors.{name}] its noise in the actuator file, or take it from a record: femfit observe."
            )
        bias = moving + list(biases).index(name) if name in biases else None
        period = reading.period(model.sample_time_s)
        measure: Measure = partial(_read, model, sensor, moving)
        slope, columns = _slope(model, sensor), float_reading(model, sensor, bias)
        samples = None if delayed is None else delayed.of_sensor(name)
        if delayed is not None and samples is not None:
            measure, slope = partial(_read_delayed, delayed, samples), partial(_delayed_slope, delayed, samples)
            columns = None
        if bias is not None:
            measure, slope = partial(_biased, measure, bias), slope and partial(_biased_slope, slope, bias)
        outputs.append(Output(name, reading.unit, measure, white**2, slope, columns, period))
    return tuple(outputs)


def bias_names(model: ActuatorModel, biases: Sequence[str]) -> tuple[str, ...]:
    """Names of the states that are biases."""
    units = {name: reading_of(model, name).unit for name in biases}
    return tuple(f"{name}_bias_{unit_in_name(unit)}" for name, unit in units.items())


def bias_deviations(model: ActuatorModel, biases: Sequence[str]) -> tuple[list[float], list[float]]:
    """First standard deviations of biases, and their random walks over sqrt(s)."""
    spans = [0.0 if name == HALL else readings_span(model, sensor_named(model, name)) for name in biases]
    first = [BIAS_DEVIATION_V if name == HALL else BIAS_SHARE * span for name, span in zip(biases, spans, strict=True)]
    return first, [BIAS_SHARE_PER_ROOT_S * span for span in spans]


def _biased(measure: Measure, bias: int, states: FloatArray) -> FloatArray:
    return measure(states) + states[:, bias]


def _biased_slope(slope: Measure, bias: int, states: FloatArray) -> FloatArray:
    result = slope(states)
    result[:, bias] = 1.0
    return result


def _read(model: ActuatorModel, sensor: AnySensor, moving: int, states: FloatArray) -> FloatArray:
    return predict_sensor(model, sensor, states[:, :moving])


def _read_delayed(delayed: DelayedSamples, samples: SensorSamples, states: FloatArray) -> FloatArray:
    before = states[:, samples.first : samples.first + samples.count] @ samples.weights[1:]
    return before + samples.weights[0] * delayed.values(samples, states) if samples.weights[0] else before


def _delayed_slope(delayed: DelayedSamples, samples: SensorSamples, states: FloatArray) -> FloatArray:
    result = np.zeros_like(states)
    if samples.weights[0]:
        result[:, : delayed.base] = samples.weights[0] * delayed.slope(samples, states)
    result[:, samples.first : samples.first + samples.count] = samples.weights[1:]
    return result


def _slope(model: ActuatorModel, sensor: AnySensor) -> Measure | None:
    """The analytic Jacobian where there is one."""
    late = model.memory_names or (model.dynamics is not None and model.dynamics.late)
    if isinstance(sensor, HallSensor):
        return None if late else partial(_hall_slope, model, sensor)
    if not records_as_it_is(model):
        return None
    if isinstance(sensor, CurrentSensor):
        return partial(_current_slope, sensor, current_index(model, sensor))
    return partial(_position_slope, sensor) if isinstance(sensor, PositionSensor) else None


def _hall_slope(model: ActuatorModel, sensor: HallSensor, states: FloatArray) -> FloatArray:
    hall, distance = model.eddy_hall, states[:, 0]
    acting = model.currents_of(states) if hall is None else hall.acting(distance, states[:, 2 : model.windings.end])
    _, in_distance, in_currents = sensor.field.derivatives(distance, acting)
    result, n, end = np.zeros_like(states), len(model.circuits), model.windings.end
    by_current = in_currents[:, None, :n]
    result[:, 0], result[:, 2 : 2 + n] = in_distance, by_current[:, 0]
    if model.eddy is not None:
        by_eddy, rising = (
            (by_current @ form.coupling)[:, 0] + form.hall for form in model.eddy.whole_forms(distance, 0, 1)
        )
        result[:, 0] += (rising * states[:, 2:end]).sum(axis=1)
        result[:, 2:end] = by_eddy
    result *= sensor.sensitivity_V_per_T
    return result


def _current_slope(sensor: CurrentSensor, index: int, states: FloatArray) -> FloatArray:
    result = np.zeros_like(states)
    result[:, index] = sensor.gain
    return result


def _position_slope(sensor: PositionSensor, states: FloatArray) -> FloatArray:
    result = np.zeros_like(states)
    result[:, 0] = piece_slope(sensor, states[:, 0])
    return result
