"""Dry friction of a guide that the side pull presses on: it grows with the square of the flux, as the pull does.

A plunger off its bore's axis is pulled sideways with a force that grows with the flux density squared. That force is no
part of an axisymmetric field; at one distance and below saturation it goes with the current squared.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters

_CREEP_M_S = 1e-3
"""Assumed: speed at which the friction has 76 % of its level, the usual one of dry friction."""

_PULL = (
    "Pull the body slowly along its guide in both directions with a force sensor, without current and at a large one."
)


def _force(d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters) -> FloatArray:
    nominal = conditions.nominal
    pressed = nominal.force_N * (i / nominal.peak_current_A) ** 2
    return np.asarray(p["share"] * pressed * np.tanh(like(conditions.velocity_m_s, d) / _CREEP_M_S))


SIDE_PULL_FRICTION = Effect(
    name="side_pull_friction",
    symptom="The body sticks the more, the larger the current; without current it slides as it should.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            "share",
            bounds=(-0.02, 2.0),
            plausible=(0.0, 0.2),
            description="Friction at the largest current, as a part of the largest force.",
            words="the guide brakes with {size} at the largest current",
            scale="force_N",
        ),
    ),
    needs=("time_s", "distance_m|hall_V", "~current_A", "iron"),
    experiment=_PULL,
    reference="H. C. Roters, Electromagnetic Devices (Wiley, 1941), chapter 9 (side thrust of eccentric plungers)",
    force=_force,
    calibrations=(Calibration({"share": 5e-3}, 40.0, _PULL),),
)
