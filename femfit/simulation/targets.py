"""Where a loop holds its body: distances given or derived, which driver and sensors must reach."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import NoReturn

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import DomainError
from femfit.device.circuit import Circuit
from femfit.device.sensors import PositionSensor
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import circuit_terms, command_limits
from femfit.model.hall_sensor import HallSensor
from femfit.model.sensors import predict_sensor, reading_of, sensor_named
from femfit.simulation.allocation import current_ranges, currents_for_force
from femfit.simulation.limits import covered_currents


def covered(model: ActuatorModel) -> ActuatorModel:
    """The model with current amplifiers whose commands it covers; voltages are kept in by the controllers."""
    circuits = [
        _covered(circuit, *pair) if circuit.drive.kind == "current" else circuit
        for circuit, pair in zip(model.circuits, covered_currents(model).T.tolist(), strict=True)
    ]
    return replace(model, circuits=tuple(circuits))


def _covered(circuit: Circuit, least_A: float, most_A: float) -> Circuit:
    low, high = command_limits(circuit)
    drive = replace(circuit.drive, current_min_A=max(low, least_A), current_max_A=min(high, most_A))
    return replace(circuit, drive=drive)


def derived_targets(model: ActuatorModel, sensors: Sequence[str]) -> tuple[float, ...]:
    """Steps over the middle 40 % of the distances at which the driver holds the body and the sensors see it."""
    box, motion = model.validity, model.require_motion()
    near, far = np.clip(motion.ends, box.distance_min_m, box.distance_max_m)
    d = np.linspace(near, far, 301)
    needed = motion.static_force(d)
    corners = [
        circuit_terms(model, d, np.tile(currents, (len(d), 1)))[0] for currents in product(*current_ranges(model))
    ]
    weakest, strongest = np.min(corners, axis=0), np.max(corners, axis=0)
    holdable = d[(weakest <= needed) & (strongest >= needed)]
    if holdable.size < 3:
        _refuse_to_hold(model, d, weakest, strongest)
    currents = currents_for_force(model, holdable, motion.static_force(holdable))
    sensed = holdable[~blind(model, sensors, holdable, currents)]
    if sensed.size < 3:
        require_sensed(model, sensors, holdable, currents)
    near, far = float(sensed[0]), float(sensed[-1])
    return near + 0.3 * (far - near), near + 0.7 * (far - near), near + 0.3 * (far - near)


def _refuse_to_hold(model: ActuatorModel, d: FloatArray, weakest: FloatArray, strongest: FloatArray) -> NoReturn:
    motion, ranges = model.require_motion(), current_ranges(model)
    needed = motion.static_force(d)
    forces, low, high = np.concatenate([weakest, strongest]), 1e3 * needed.min(), 1e3 * needed.max()
    asked = (
        f"the weight is {low:.4g} mN" if low == high else f"weight, springs and load ask for {low:.4g}..{high:.4g} mN"
    )
    spans = ", ".join(f"{span[0]:.3g}..{span[1]:.3g} A" for span in ranges)
    raise DomainError(
        f"Model {model.name!r} cannot hold its body of {1e3 * motion.mass_kg:g} g anywhere in {1e3 * d[0]:g}.."
        f"{1e3 * d[-1]:g} mm: {asked}, and with {spans} the force is {1e3 * forces.min():.4g}.."
        f"{1e3 * forces.max():.4g} mN. It is not an actuator that levitates this body; change mass or supply to "
        "simulate one that is."
    )


def blind(model: ActuatorModel, sensors: Sequence[str], distance: FloatArray, currents: FloatArray) -> BoolArray:
    """At which points of rest a Hall element or position sensor gives the end of its range, whatever the distance."""
    states = np.zeros((len(distance), model.order))
    states[:, 0], states[:, 2 : 2 + currents.shape[1]] = distance, currents
    ended = np.zeros(len(distance), dtype=np.bool_)
    for name in sensors:
        sensor = sensor_named(model, name)
        if isinstance(sensor, HallSensor | PositionSensor):
            reading, value = reading_of(model, name), predict_sensor(model, sensor, states)
            ended |= (value <= reading.low) | (value >= reading.high)
    return ended


def require_sensed(model: ActuatorModel, sensors: Sequence[str], distance: FloatArray, currents: FloatArray) -> None:
    """Refuse points of rest at which a sensor of the distance is at the end of its range."""
    for name in sensors:
        dark = blind(model, (name,), distance, currents)
        if not np.any(dark):
            continue
        sensor = sensor_named(model, name)
        if isinstance(sensor, HallSensor):
            _refuse_hall(
                model, sensor, distance[dark], currents[dark] if len(model.circuits) > 1 else currents[dark, 0]
            )
        reading = reading_of(model, name)
        states = np.zeros((1, model.order))
        states[0, 0] = distance[dark][0]
        value = float(predict_sensor(model, sensor, states)[0])
        raise DomainError(
            f"The sensor {name} of model {model.name!r} must stay within its range of {reading.low:g}.."
            f"{reading.high:g} {reading.unit} where the body is held; at {1e3 * states[0, 0]:.4g} mm it would read "
            f"{value:.4g} {reading.unit}. Give [sensors.{name}] a wider range, or choose other reference distances."
        )


def _refuse_hall(model: ActuatorModel, sensor: HallSensor, distance: FloatArray, current: FloatArray) -> NoReturn:
    field = sensor.field.field(distance, current)
    strongest = int(np.argmax(np.abs(field)))
    raise DomainError(
        f"The Hall element of model {model.name!r} must stay within its output range of {sensor.output_min_V:g}.."
        f"{sensor.output_max_V:g} V where the body is held; {1e3 * field[strongest]:.4g} mT at "
        f"{1e3 * distance[strongest]:.4g} mm and {sensor.sensitivity_V_per_T:g} V/T ask for "
        f"{sensor.quiescent_V + sensor.sensitivity_V_per_T * field[strongest]:.4g} V. Give the sensor a smaller "
        "sensitivity_V_per_T, or move the element."
    )
