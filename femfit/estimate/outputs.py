"""The sensors of a model as a filter sees them: functions of the state, noise, and a bias where one is estimated."""

from collections.abc import Sequence
from functools import partial

from femfit.core.errors import FilterError
from femfit.estimate.constants import BIAS_DEVIATION_V, BIAS_SHARE, BIAS_SHARE_PER_ROOT_S
from femfit.estimate.noise import FilterNoise
from femfit.estimate.process import Output
from femfit.estimate.process_graph import ProcessGraph
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallSensor
from femfit.model.sensors import HALL, reading_of, readings_span, sensor_named, unit_in_name


def outputs_of(graph: ProcessGraph, sensors: Sequence[str], noise: FilterNoise) -> tuple[Output, ...]:
    """One output a sensor."""
    model, outputs = graph.model, []
    for name in sensors:
        reading = reading_of(model, name)
        hall = isinstance(sensor_named(model, name), HallSensor)
        white = noise.hall_V if hall else noise.sensors.get(name, reading.white)
        if not white > 0.0:
            raise FilterError(
                f"A filter must know the noise of sensor {name!r}, and it must be > 0 {reading.unit}; it is {white:g}. "
                f"Give [sensors.{name}] its noise in the actuator file, or take it from a record: femfit observe."
            )
        measure, slope = partial(graph.measure, name), partial(graph.gradient, name)
        outputs.append(Output(name, reading.unit, measure, white**2, slope, reading.period(model.sample_time_s)))
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
