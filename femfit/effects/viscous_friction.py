"""A force against the motion, in proportion to its velocity: air, grease, eddy currents in fixed conductors.

Force towards the electromagnet = damping m v, where v > 0 is falling away.
"""

from femfit.core.amount import amount
from femfit.effects.conditions import like
from femfit.effects.effect import Calibration, Effect, EffectParameter

_SWING = "Let the body swing on a spring, the coil open, and record how its amplitude falls."

VISCOUS_FRICTION = Effect(
    name="viscous_friction",
    symptom="Oscillations die out faster than the model's.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            "damping_per_s",
            "1/s",
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
