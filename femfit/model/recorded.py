"""The one place where the effects of a bench meet the sensors of a model, in plant and filters.

An effect on a recorded channel says which distance and current body and winding have where these were recorded; a
sensor of a model reads what is recorded, so that it undoes the same effects.
"""

from dataclasses import replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.stages import recorded, recorded_setting, true_setting, with_further_force
from femfit.model.actuator_model import ActuatorModel


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
    result[..., 2 : 2 + len(model.circuits)] = currents.reshape(*distance.shape, -1)[..., : len(model.circuits)]
    return result


def true_setting_of(model: ActuatorModel, distance: FloatArray, current: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance and current that body and windings have where these were recorded, at rest."""
    if model.conditions is None:
        return distance, current
    return true_setting(model.effects, distance, current, model.conditions)


def recorded_force(model: ActuatorModel, state: FloatArray, time: FloatArray | float = 0.0) -> FloatArray:
    """The force in N that a sensor records in states of shape (..., order)."""
    distance, currents = state[..., 0], model.currents_of(state)
    force = model.force_in(state)
    if model.conditions is None:
        return force
    at = replace(model.conditions, velocity_m_s=state[..., 1], time_s=time, elapsed=time)
    first = currents[..., 0] if model.conditions.nominal.circuits else currents
    force = with_further_force(model.effects, force, distance, first, at)
    return np.asarray(recorded(model.effects, {"force_N": force}, distance, first, at)["force_N"])
