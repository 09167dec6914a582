"""Friction against the motion: dry, whatever the speed and larger where it starts, or growing with the velocity.

Force towards the electromagnet = level weight sign(v), rounded at small speeds, damping m v of an oil film or of eddy
currents, or drag m |v| v of a fluid that is displaced; v > 0 is falling away.
"""

import numpy as np

from femfit.core.amount import amount
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
            bounds=(-0.05, 5.0),
            plausible=(0.0, 0.5),
            description="Friction as a part of the body's weight.",
            words="dry friction brakes with {signed}",
            scale="weight_N",
        ),
        EffectParameter(
            "breakaway",
            bounds=(-0.05, 5.0),
            plausible=(0.0, 0.3),
            description="Further friction at small speeds, as a part of the body's weight.",
            words="it takes {size} {more|less} to start",
            scale="weight_N",
        ),
        EffectParameter(
            "creep_m_s",
            unit="m/s",
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


_SWING = "Let the body swing on a spring, the coil open, and record how its amplitude falls."

VISCOUS_FRICTION = Effect(
    name="viscous_friction",
    symptom="Oscillations die out faster than the model's.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            "damping_per_s",
            unit="1/s",
            bounds=(-10.0, 1e4),
            plausible=(0.0, 50.0),
            description="Damping constant over the model's mass: without other forces the velocity falls at this rate.",
        ),
    ),
    needs=("time_s", "distance_m|hall_V"),
    experiment=_SWING,
    reference="H. Goldstein, Classical Mechanics (Addison-Wesley, 1980), section 1.5",
    force=lambda d, i, conditions, p: (
        p["damping_per_s"] * conditions.nominal.mass_kg * like(conditions.velocity_m_s, d)
    ),
    calibrations=(Calibration({"damping_per_s": 0.5}, 60.0, _SWING),),
    words=lambda p, nominal: [f"friction brakes with {amount(p['damping_per_s'] * nominal.mass_kg, 'N')} at 1 m/s"],
)


FLUID_DRAG = Effect(
    name="fluid_drag",
    symptom="Fast strokes take longer than the model's, slow ones do not.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            "drag_per_m",
            unit="1/m",
            bounds=(-10.0, 1e6),
            plausible=(0.0, 200.0),
            description="Drag over the model's mass and the velocity squared.",
        ),
    ),
    needs=("time_s", "distance_m|hall_V"),
    experiment="Repeat a fast stroke in air, or with the ports of the fluid open, and compare its time.",
    reference="Batchelor, An Introduction to Fluid Dynamics (1967), section 5.11",
    force=lambda d, i, conditions, p: (
        p["drag_per_m"]
        * conditions.nominal.mass_kg
        * np.abs(conditions.velocity_m_s)
        * like(conditions.velocity_m_s, d)
    ),
    words=lambda p, nominal: [
        f"a fluid brakes with {amount(p['drag_per_m'] * nominal.mass_kg, 'N')} at 1 m/s, with the square of the speed"
    ],
)
