"""What a bench would read of an actuator model: the one prediction of compare, diagnose, add and suggest."""

from collections.abc import Iterable

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import AddedEffect
from femfit.model.actuator_model import ActuatorModel
from femfit.model.coenergy_series import changed_coenergy
from femfit.model.effect_dynamics import hall_field
from femfit.model.with_effects import base_coenergy


def predict_readings(
    model: ActuatorModel,
    distance: FloatArray,
    current: FloatArray,
    at: Conditions,
    effects: Iterable[AddedEffect] | None = None,
) -> dict[str, FloatArray]:
    """Readings of a body held at rest.

    force_N is the force on the body towards the electromagnet, flux_linkage_Wb that of the winding, hall_V the Hall
    element's output before clipping and rounding, voltage_V the voltage across the winding (R i on a static bench).

    Parameters
    ----------
    model : ActuatorModel
        Its base and its effects count; it is evaluated outside of its validity box as well.
    distance, current : array, shape (n,)
        As recorded, in m and A.
    effects : iterable of AddedEffect or None
        In place of the model's own.

    Returns
    -------
    dict of str to array, each of shape (n,)
        Channels that the model can predict: hall_V only with a sensor, voltage_V only with a circuit.
    """
    base = model.without_effects
    added = tuple(model.effects if effects is None else effects)
    d, i = np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64)
    for one in added:
        if one.effect.setting is not None:
            d, i = one.effect.setting(d, i, at, one.parameters)
    coenergy = base_coenergy(base)
    series = changed_coenergy(coenergy, added, at)(d, i, 1, 1)
    values = {"force_N": -series.derivative(1, 0), "flux_linkage_Wb": series.derivative(0, 1)}
    if base.sensor is not None:
        late = any(one.effect.hall_point for one in added)
        field = hall_field(coenergy, added, d, i, at) if late else series.derivative(0, 0, 1)
        values["hall_V"] = base.sensor.quiescent_V + base.sensor.sensitivity_V_per_T * field
    if base.circuit is not None:
        values["voltage_V"] = _voltage(base.circuit.resistance_ohm, i, at, added)
    for one in added:
        if one.effect.force is not None:
            values["force_N"] = values["force_N"] + one.effect.force(d, i, at, one.parameters)
    for one in added:
        if one.effect.readings is not None:
            values = dict(one.effect.readings(values, d, i, at, one.parameters))
    return values


def _voltage(resistance: float, current: FloatArray, at: Conditions, added: tuple[AddedEffect, ...]) -> FloatArray:
    """R i at rest, R as the effects change it.

    What the driver does to a commanded voltage does not show here: a bench reads the voltage across the winding.
    """
    ohms = like(resistance, current)
    for one in added:
        if one.effect.circuit is not None:
            ohms, _ = one.effect.circuit(ohms, np.zeros_like(current), current, at, one.parameters)
    return ohms * current
