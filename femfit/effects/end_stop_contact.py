"""The moving part touches a stop at the near or the far end of its travel and is pushed back.

A flat stop is a spring; a rounded one stiffens with the square root of its compression (Hertz).

References
----------
K. L. Johnson, Contact Mechanics (Cambridge University Press, 1985), section 4.2.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.effect import Conditions, Effect, EffectParameter, Parameters


def _force(d: FloatArray, i: FloatArray, at: Conditions, p: Parameters) -> FloatArray:
    near, far = at.nominal.distance_min_m, at.nominal.distance_max_m
    reach = p["reach"] * (far - near)
    pressed = np.maximum(0.0, near + reach - d) / reach
    pulled = np.maximum(0.0, d - far + reach) / reach
    push = p["near_flat"] * pressed + p["near_round"] * pressed**1.5
    return np.asarray(at.nominal.force_N * (p["far_flat"] * pulled - push))


def _stop(name: str, description: str) -> EffectParameter:
    return EffectParameter(
        name=name, unit="", lower=0.0, upper=100.0, sane=(0.0, 1.0), description=description, of="force_N"
    )


END_STOP_CONTACT = Effect(
    name="end_stop_contact",
    symptom="The force breaks away from the model within a small distance from one end of the travel, at any current.",
    acts_on=("force",),
    parameters=(
        _stop("near_flat", "Push of a flat stop at the smallest distance, as a part of the largest force."),
        _stop("near_round", "The same for a rounded stop."),
        _stop("far_flat", "Push of a flat stop at the largest distance, as a part of the largest force."),
        EffectParameter(
            name="reach",
            unit="",
            lower=0.005,
            upper=0.9,
            sane=(0.02, 0.3),
            description="Part of the travel over which the stop is touched.",
            null=0.1,
            shape=True,
        ),
    ),
    needs=("~distance_m", "force_N|time_s"),
    experiment="Measure the force every few hundredths of a millimetre near the stop, the current off.",
    reference="Johnson, Contact Mechanics (1985), section 4.2",
    force=_force,
)
"""A spring, or a Hertzian contact, that acts beyond the stop."""
