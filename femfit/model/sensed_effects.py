"""What pickup coils, and a Hall element beside several circuits, see of a field that effects change.

What magnets and currents make together is of the first degree in them where nothing saturates, so that a remanence and
numbers of turns scale it as they scale W' (:mod:`femfit.effects.tolerances`). Other effects on the magnetics are not
followed to such a sensor; its value is then refused, and the model without it is as good as before.

The one place where the effects of a bench meet the sensors of a model, in plant and filters.

An effect on a recorded channel says which distance and current body and winding have where these were recorded; a
sensor of a model reads what is recorded, so that it undoes the same effects.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.errors import MissingPartError
from femfit.core.numerics import FloatArray
from femfit.effects.catalogue import SEPARATOR, source_scales
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.effects.stages import recorded, recorded_setting, true_setting, with_further_force
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallField, HallSensor, OtherSensor, PickupSensor, SensedField
from femfit.model.magnetics import only_current

SCALING = ("remanence", "turns")
"""Effects that scale what makes the field."""


@dataclass(frozen=True, eq=False)
class UnknownField(SensedField):
    """A field that effects change in a way that is not known at this sensor."""

    refusal: str

    def _values(self, distance: FloatArray, currents: FloatArray, *, slopes: bool) -> list[FloatArray]:  # noqa: ARG002
        raise MissingPartError(self.refusal)


def pickups_with_effects(
    sensors: Sequence[OtherSensor], effects: Sequence[AddedEffect], circuits: Sequence[str]
) -> tuple[OtherSensor, ...]:
    """The sensors of a model, pickup coils with the flux linkage that effects leave them."""
    return tuple(
        replace(one, flux=_changed(one.flux, f"pickup coil {one.name!r}", effects, circuits))
        if isinstance(one, PickupSensor)
        else one
        for one in sensors
    )


def pickups_as_fitted(sensors: Sequence[OtherSensor], fitted: Sequence[OtherSensor]) -> tuple[OtherSensor, ...]:
    """The sensors of a model with effects, pickup coils with the flux linkage that they had before."""
    flux = {one.name: one.flux for one in fitted if isinstance(one, PickupSensor)}
    return tuple(
        replace(one, flux=flux[one.name]) if isinstance(one, PickupSensor) and one.name in flux else one
        for one in sensors
    )


@dataclass(frozen=True, eq=False)
class ReadField(HallField):
    """The field that the Hall element of several circuits seems to show, as effects change its reading."""

    inner: HallField
    effects: tuple[AddedEffect, ...]
    conditions: Conditions
    quiescent_V: float
    sensitivity_V_per_T: float

    def after(self, time: FloatArray | float) -> "ReadField":
        """The same at a time in s since the start."""
        return replace(self, conditions=replace(self.conditions, time_s=time, elapsed=time))

    def field(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """B_z in T, of shape (...)."""
        return self._apparent(self.inner.field(distance, currents), distance, currents)

    def derivatives(self, distance: FloatArray, currents: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As of the field itself, by the chain rule with a central difference of the reading over the field."""
        field, along, by_current = self.inner.derivatives(distance, currents)
        step = 1e-3 / abs(self.sensitivity_V_per_T)  # a millivolt
        above, below = (self._apparent(field + sign * step, distance, currents) for sign in (1.0, -1.0))
        slope = (above - below) / (2.0 * step)
        return self._apparent(field, distance, currents), slope * along, slope[..., None] * by_current

    def _apparent(self, field: FloatArray, distance: FloatArray, currents: FloatArray) -> FloatArray:
        volts = np.ravel(self.quiescent_V + self.sensitivity_V_per_T * field)
        d, i = (np.broadcast_to(values, np.shape(field)).ravel() for values in (distance, currents[..., 0]))
        read = recorded(self.effects, {"hall_V": volts}, d, i, self.conditions)["hall_V"]
        return np.asarray((read - self.quiescent_V) / self.sensitivity_V_per_T).reshape(np.shape(field))


def hall_with_effects(
    sensor: HallSensor | None, effects: Sequence[AddedEffect], circuits: Sequence[str]
) -> HallSensor | None:
    """The Hall element of several circuits with the field that effects leave it; what they do to its reading apart."""
    if sensor is None or not isinstance(sensor.field, SensedField):
        return sensor
    return replace(sensor, field=_changed(sensor.field, "Hall element", effects, circuits))


def hall_as_read(
    sensor: HallSensor | None, effects: Sequence[AddedEffect], conditions: Conditions
) -> HallSensor | None:
    """The Hall element of several circuits as plant and filters have it, with the effects on its reading."""
    of_readings = tuple(added for added in effects if added.effect.readings is not None)
    if sensor is None or not of_readings:
        return sensor
    converted = sensor.quiescent_V, sensor.sensitivity_V_per_T
    return replace(sensor, field=ReadField(sensor.field, of_readings, conditions, *converted))


def _changed(field: SensedField, what: str, effects: Sequence[AddedEffect], circuits: Sequence[str]) -> SensedField:
    magnetic = [one.effect.name for one in effects if "magnetics" in one.effect.acts_on]
    others = [name for name in magnetic if name.partition(SEPARATOR)[0] not in SCALING]
    if others:
        named = ", ".join(others)
        refusal = (
            f"What the {what} reads must be known under the model's effects; {named} changes the field in a way that "
            f"is followed to force and flux linkage only. Leave that sensor out, or take {named} out of the model."
        )
        return UnknownField(**vars(field), refusal=refusal)
    magnets, *currents = source_scales(effects, circuits)
    return field.scaled(magnets, currents)


def records_as_it_is(model: ActuatorModel) -> bool:
    """Whether distance and currents are recorded as body and windings have them."""
    return all(added.effect.setting is None for added in model.effects)


def recorded_state(model: ActuatorModel, state: FloatArray, time: FloatArray | float = 0.0) -> FloatArray:
    """States of shape (..., order) with the distance and the currents that are recorded there."""
    if model.conditions is None or records_as_it_is(model):
        return state
    at = replace(model.conditions, velocity_m_s=state[..., 1], time_s=time, elapsed=time)
    result = state.copy()
    distance, currents = recorded_setting(model.effects, state[..., 0], model.currents_of(state), at)
    result[..., 0] = distance
    result[..., 2 : 2 + len(model.circuits)] = currents
    return result


def true_setting_of(model: ActuatorModel, distance: FloatArray, currents: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance (...) and currents (..., n) that body and windings have where these were recorded, at rest."""
    if model.conditions is None:
        return distance, currents
    return true_setting(model.effects, distance, currents, model.conditions)


def recorded_force(model: ActuatorModel, state: FloatArray, time: FloatArray | float = 0.0) -> FloatArray:
    """The force in N that a sensor records in states of shape (..., order)."""
    distance, first = state[..., 0], only_current(model.currents_of(state)[..., :1])
    force = model.windings.magnetics.force(distance, state[..., 2 : model.windings.end])
    if model.conditions is None:
        return force
    at = replace(model.conditions, velocity_m_s=state[..., 1], time_s=time, elapsed=time)
    force = with_further_force(model.effects, force, distance, first, at)
    return np.asarray(recorded(model.effects, {"force_N": force}, distance, first, at)["force_N"])
