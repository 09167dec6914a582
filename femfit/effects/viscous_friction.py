"""A force against the motion, in proportion to its velocity: air, grease, eddy currents in fixed conductors."""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters


def _force(d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters) -> FloatArray:
    return p["damping_per_s"] * conditions.nominal.mass_kg * like(conditions.velocity_m_s, d)


VISCOUS_FRICTION = Effect(
    name="viscous_friction",
    symptom="Oscillations die out faster than the model's.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            name="damping_per_s",
            unit="1/s",
            lower=-10.0,
            upper=1e4,
            plausible=(0.0, 50.0),
            description="Damping constant over the model's mass: without other forces the velocity falls at this rate.",
        ),
    ),
    needs=("time_s", "distance_m|hall_V"),
    experiment="Let the body swing on a spring, the coil open, and record how its amplitude falls.",
    reference="H. Goldstein, Classical Mechanics (Addison-Wesley, 1980), section 1.5",
    force=_force,
    calibrations=(
        Calibration(
            {"damping_per_s": 0.5},
            60.0,
            "Let the body swing on a spring, the coil open, and record how its amplitude falls.",
        ),
    ),
)
"""Force towards the electromagnet = damping m v, where v > 0 is falling away."""
