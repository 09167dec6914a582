"""What pickup coils, and a Hall element beside several circuits, see of a field that effects change.

What magnets and currents make together is of the first degree in them where nothing saturates, so that a remanence and
numbers of turns scale it as they scale W' (:mod:`femfit.effects.tolerances`). Other effects on the magnetics are not
followed to such a sensor; its value is then refused, and the model without it is as good as before.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from femfit.core.arrays import FloatArray
from femfit.core.errors import MissingPartError
from femfit.effects.effect import AddedEffect
from femfit.effects.of_circuits import SEPARATOR, source_scales
from femfit.model.hall_sensor import HallSensor
from femfit.model.other_sensor import OtherSensor
from femfit.model.pickup import PickupSensor
from femfit.model.sensed_field import SensedField

SCALING = ("remanence", "turns")
"""Effects that scale what makes the field."""


@dataclass(frozen=True, eq=False)
class UnknownField(SensedField):
    """A field that effects change in a way that is not known at this sensor."""

    refusal: str

    def _values(self, distance: FloatArray, current: FloatArray, *, slopes: bool) -> list[FloatArray]:  # noqa: ARG002
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


def hall_with_effects(
    sensor: HallSensor | None, effects: Sequence[AddedEffect], circuits: Sequence[str]
) -> HallSensor | None:
    """The Hall element of several circuits with the field that effects leave it."""
    if sensor is None or not isinstance(sensor.field, SensedField):
        return sensor
    return replace(sensor, field=_changed(sensor.field, "Hall element", effects, circuits))


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
