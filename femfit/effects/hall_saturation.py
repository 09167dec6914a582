"""The Hall element or its amplifier falls behind in large fields: a cubic onset, or a limit with a knee."""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Effect, EffectParameter, Parameters, in_channel

_ROUNDING = 0.03
"""Half width of the knee's corner over the largest swing: amplifiers do not clip at once."""


def _beyond(excess: FloatArray) -> FloatArray:
    """max(0, excess) with a rounded corner."""
    return np.asarray(0.5 * (excess + np.sqrt(excess**2 + _ROUNDING**2)))


def _limited(volts: FloatArray, conditions: Conditions, p: Parameters) -> FloatArray:
    swing, knee = conditions.nominal.hall_swing_V, p["knee"]
    x = (volts - conditions.nominal.hall_quiescent_V) / swing
    # Odd in x and zero at zero
    limited = _beyond(x - knee) - _beyond(-x - knee)
    return np.asarray(volts - swing * (p["cubic_loss"] * x**3 + p["limited_loss"] * limited))


HALL_SATURATION = Effect(
    name="hall_saturation",
    symptom="The Hall voltage falls behind the model where it is far from its quiescent value.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "cubic_loss",
            "",
            bounds=(-0.05, 0.33),
            plausible=(0.0, 0.2),
            description="Lost part of the largest swing, growing with the cube of the field.",
            words="the Hall voltage {loses|gains} {size} at its largest swing",
        ),
        EffectParameter(
            "limited_loss",
            "",
            bounds=(0.0, 1.0),
            plausible=(0.0, 1.0),
            description="Lost part of the sensitivity beyond the knee; 1 is a hard limit.",
            words="the Hall element loses {size} of its sensitivity beyond a knee",
        ),
        EffectParameter(
            "knee",
            "",
            bounds=(0.1, 1.2),
            plausible=(0.4, 1.0),
            description="Where the limit begins, as a part of the model's largest swing.",
            null=0.8,
            nonlinear=True,
        ),
    ),
    needs=("hall_V",),
    experiment="Go as near as possible at the largest current of each sign, and compare the Hall voltage with that of "
    "a second element of a lower sensitivity.",
    reference="Popovic, Hall Effect Devices (2004), section 4.5 (nonlinearity)",
    readings=in_channel("hall_V", _limited),
)
