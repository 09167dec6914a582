"""What pickup coils see of a field that effects change.

What magnets and currents make together is of the first degree in them where nothing saturates, so that a remanence and
numbers of turns scale it as they scale W' (:mod:`femfit.effects.tolerances`). Other effects on the magnetics are not
followed to such a sensor; its value is then refused, and the model without it is as good as before.

The one place where the effects of a bench meet the sensors of a model, in plant and filters.

An effect on a recorded channel says which distance and current body and winding have where these were recorded; a
sensor of a model reads what is recorded, so that it undoes the same effects.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

from casadi import SX

from femfit.core.errors import MissingPartError
from femfit.core.numerics import FloatArray
from femfit.effects.catalogue import SEPARATOR, source_scales
from femfit.effects.effect import AddedEffect
from femfit.effects.stages import true_setting
from femfit.model.hall import OtherSensor, PickupSensor, SensedField

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel

SCALING = ("remanence", "turns")
"""Effects that scale what makes the field."""


@dataclass(frozen=True, eq=False)
class UnknownField(SensedField):
    """A field that effects change in a way that is not known at this sensor."""

    refusal: str

    def expression(self, distance: SX, currents: SX) -> SX:  # noqa: ARG002
        """Refused."""
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


def _changed(field: SensedField, what: str, effects: Sequence[AddedEffect], circuits: Sequence[str]) -> SensedField:
    magnetic = [one.effect.name for one in effects if "magnetics" in one.effect.acts_on]
    others = [name for name in magnetic if name.partition(SEPARATOR)[0] not in SCALING]
    if others:
        named = ", ".join(others)
        refusal = (
            f"What the {what} reads must be known under the model's effects; {named} changes the field in a way that "
            f"is followed to force and flux linkage only. Leave that sensor out, or take {named} out of the model."
        )
        return UnknownField(**{one.name: getattr(field, one.name) for one in fields(field)}, refusal=refusal)
    magnets, *currents = source_scales(effects, circuits)
    return field.scaled(magnets, currents)


def true_setting_of(
    model: "ActuatorModel", distance: FloatArray, currents: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distance (...) and currents (..., n) that body and windings have where these were recorded, at rest."""
    if model.conditions is None:
        return distance, currents
    return true_setting(model.effects, distance, currents, model.conditions)
