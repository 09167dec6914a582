"""Dry friction in a guide: a force against the motion whatever its speed, larger where it starts to move.

Force towards the electromagnet = level weight sign(v), rounded at small speeds.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters

_PULL = "Pull the body slowly along its guide in both directions with a force sensor, the coil open."


def _force(d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters) -> FloatArray:
    v, weight = like(conditions.velocity_m_s, d), conditions.nominal.weight_N
    level = p["level"] + p["breakaway"] * np.exp(-((v / (10.0 * p["creep_m_s"])) ** 2))
    return np.asarray(weight * level * np.tanh(v / p["creep_m_s"]))


COULOMB_FRICTION = Effect(
    name="coulomb_friction",
    symptom="The body sticks: it answers small changes late or not at all, and stops short.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            "level",
            "",
            bounds=(-0.05, 5.0),
            plausible=(0.0, 0.5),
            description="Friction as a part of the body's weight.",
            words="dry friction brakes with {signed}",
            scale="weight_N",
        ),
        EffectParameter(
            "breakaway",
            "",
            bounds=(-0.05, 5.0),
            plausible=(0.0, 0.3),
            description="Further friction at small speeds, as a part of the body's weight.",
            words="it takes {size} {more|less} to start",
            scale="weight_N",
        ),
        EffectParameter(
            "creep_m_s",
            "m/s",
            bounds=(1e-5, 0.1),
            plausible=(3e-4, 3e-3),
            description="Speed at which the friction has 76 % of its level.",
            null=1e-3,
            nonlinear=True,
        ),
    ),
    needs=("time_s", "distance_m|hall_V"),
    experiment=_PULL,
    reference="Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083",
    force=_force,
    calibrations=(Calibration({"level": 0.01, "breakaway": 0.02}, 40.0, _PULL),),
)
