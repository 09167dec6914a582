"""What the sensors of a model read in a state, as expressions.

A position sensor reads its characteristic of the distance, a current sensor gain i + offset, an acceleration sensor
d'', which is zero at rest, or d'' - g where it reads gravity, as accelerometers of silicon do; a force sensor the
magnetic force, and a pickup coil the voltage that its flux linkage induces. Distance, current and force are those that
the effects of the model have recorded.

What magnets and currents make together is of the first degree in them where nothing saturates, so that a remanence and
numbers of turns scale what a pickup coil sees as they scale W' (:mod:`femfit.effects.circuit`). Other effects on the
magnetics are not followed to such a sensor; its value is then refused, and the model without it is as good as before.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.errors import MissingPartError
from femfit.core.graph import Expression, row_of
from femfit.device.electrics import AccelerationSensor, CurrentSensor, ForceSensor, PositionSensor
from femfit.effects.catalogue import SEPARATOR, source_scales
from femfit.effects.conditions import Conditions
from femfit.effects.stages import hall_point, recorded, recorded_setting, with_further_force
from femfit.model.hall import HallSensor, OtherSensor, PickupSensor

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel
    from femfit.model.equations import Equations

AnySensor = HallSensor | OtherSensor


def reading_expression(equations: "Equations", sensor: AnySensor, state: SX, voltage: SX, time: SX) -> SX:
    """The reading of a sensor in its unit, without delay, noise, clipping and rounding.

    Parameters
    ----------
    voltage : SX, shape (n,)
        Across the circuits; it reaches pickup coils and acceleration sensors alone.
    """
    _, velocity, _, memory = equations.parts(state)
    now = replace(equations.conditions(velocity, memory), time_s=time, elapsed=time)
    return READINGS[type(sensor)](sensor, equations, state, voltage, now)


SCALING = ("remanence", "turns")
"""Effects that scale what makes the field."""


def pickup_flux(model: "ActuatorModel", sensor: PickupSensor, state: SX) -> SX:
    """The flux linkage of a pickup coil in Wb, of the first degree in all sources: s_0 f(d, i_1 s_1 / s_0, ..).

    Raises
    ------
    MissingPartError
        Beside eddy currents, and beside effects of which it is not known what they change of it.
    """
    magnetic = [added.effect for added in model.effects if "magnetics" in added.effect.acts_on]
    named = ", ".join(effect.name for effect in magnetic if effect.name.partition(SEPARATOR)[0] not in SCALING)
    if model.eddy is not None:
        raise MissingPartError(
            f"The eddy currents of model {model.name!r} do not say what pickup coil {sensor.name!r} reads, which they "
            "change. Leave that out, or fit the model without eddy currents: take frequency_Hz out of [solver]."
        )
    if named:
        raise MissingPartError(
            f"What the pickup coil {sensor.name!r} reads must be known under the model's effects; {named} changes the "
            "field in a way that is followed to force and flux linkage only. Leave that sensor out, or take "
            f"{named} out of the model."
        )
    magnets, *currents = source_scales(model.effects, model.circuit_names)
    scales = ca.vertcat(SX(0, 1), *currents) / magnets
    return magnets * sensor.flux.expression(state[0], state[2 : 2 + len(model.circuits)] * scales)


def characteristic(sensor: PositionSensor, distance: Expression) -> Expression:
    """Reading at distances in m, continued with the slope of the last piece, so that an estimate is led back."""
    start, first, slope = piece_of(sensor, distance)
    return first + slope * (distance - start)


def piece_of(sensor: PositionSensor, distance: Expression) -> tuple[Expression, Expression, Expression]:
    """Where the piece of a characteristic begins, its first reading there, and its slope."""
    distances, read = np.asarray(sensor.distances_m), np.asarray(sensor.readings)
    pieces = np.stack([distances[:-1], read[:-1], np.diff(read) / np.diff(distances)], axis=1)
    if isinstance(distance, SX):
        start, first, slope = ca.vertsplit(row_of(pieces, [distances[1:-1]], [distance]))
    else:
        start, first, slope = np.moveaxis(pieces[distances[1:-1].searchsorted(distance, "right")], -1, 0)
    return start, first, slope


def current_index(model: "ActuatorModel", sensor: CurrentSensor) -> int:
    """Which state of a model a current sensor reads; that of the only circuit, whatever it is called.

    Raises
    ------
    MissingPartError
        If the model has no circuit of that name.
    """
    names = model.circuit_names
    if len(names) == 1:
        return 2
    if sensor.circuit not in names:
        raise MissingPartError(
            f"Model {model.name!r} must have the circuit {sensor.circuit!r} for its current sensor {sensor.name!r}; it "
            f"has {', '.join(names) or 'none'}. Name one of them in [sensors.{sensor.name}], and fit again."
        )
    return 2 + names.index(sensor.circuit)


def _setting(equations: "Equations", state: SX, conditions: Conditions) -> tuple[SX, SX]:
    """Distance and currents as they are recorded."""
    currents = ca.vertcat(SX(0, 1), *ca.vertsplit(equations.parts(state)[2])[: len(equations.model.circuits)])
    return recorded_setting(equations.model.effects, state[0], currents, conditions)


def _current(sensor: CurrentSensor, equations: "Equations", state: SX, _voltage: SX, conditions: Conditions) -> SX:
    return (
        sensor.gain * _setting(equations, state, conditions)[1][current_index(equations.model, sensor) - 2]
        + sensor.offset
    )


def _hall(_sensor: HallSensor, equations: "Equations", state: SX, _voltage: SX, conditions: Conditions) -> SX:
    """The output that belongs to the distance and the current of the reading."""
    model, (distance, _, currents, _) = equations.model, equations.parts(state)
    sensor, eddy = model.without_effects.require_sensor(), model.eddy
    then = hall_point(model.effects, distance, currents, conditions)
    field = model.require_sensor().field.with_memory(conditions.memory)
    value = field(*then) if eddy is None else eddy.field(field, *then)
    output, first = sensor.quiescent_V + sensor.sensitivity_V_per_T * value, currents[0] if currents.numel() else SX(0)
    return SX(recorded(model.effects, {"hall_V": output}, distance, first, conditions)["hall_V"])


def _force(_sensor: ForceSensor, equations: "Equations", state: SX, _voltage: SX, conditions: Conditions) -> SX:
    model, (distance, _, currents, memory) = equations.model, equations.parts(state)
    place = distance, currents[0] if currents.numel() else SX(0), conditions
    force = -ca.gradient(model.windings.magnetics.with_memory(memory)(distance, currents), distance)
    force = with_further_force(model.effects, force, *place)
    return SX(recorded(model.effects, {"force_N": force}, *place)["force_N"])


def _pickup(sensor: PickupSensor, equations: "Equations", state: SX, voltage: SX, _at: Conditions) -> SX:
    flux = pickup_flux(equations.model, sensor, state)
    return ca.dot(ca.gradient(flux, state), equations.rates_at(state, voltage))


def _acceleration(sensor: AccelerationSensor, equations: "Equations", state: SX, voltage: SX, _at: Conditions) -> SX:
    motion, rate = equations.model.require_motion(), equations.rates_at(state, voltage)[1]
    if motion.near_stop is not None:  # which carries what presses the body to it
        rate = ca.if_else(state[0] <= motion.near_stop.distance_m, ca.fmax(rate, 0.0), rate)
    if motion.far_stop is not None:
        rate = ca.if_else(state[0] >= motion.far_stop.distance_m, ca.fmin(rate, 0.0), rate)
    return rate - motion.gravity_m_s2 if sensor.reads_gravity else rate


READINGS: dict[type, Callable[..., SX]] = {
    HallSensor: _hall,
    CurrentSensor: _current,
    PositionSensor: lambda sensor, equations, state, _, now: characteristic(sensor, _setting(equations, state, now)[0]),
    PickupSensor: _pickup,
    AccelerationSensor: _acceleration,
    ForceSensor: _force,
}
"""What each kind of sensor reads: of the sensor, the equations, their state, the voltage and the conditions."""
