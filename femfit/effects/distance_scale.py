"""The stage's scale is wrong: a leadscrew's pitch, an encoder's count, a lever's ratio.

Stages are zeroed where the parts touch, so the scale acts about the distance 0, not about the middle of the table.
"""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters


def _setting(d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters) -> tuple[FloatArray, FloatArray]:
    return (1.0 + p["scale_error"]) * d, i


DISTANCE_SCALE = Effect(
    name="distance_scale",
    symptom="Every channel looks as if measured at another distance, the more so the further away.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            name="scale_error",
            unit="",
            lower=-0.3,
            upper=0.3,
            plausible=(-0.05, 0.05),
            description="True over recorded distance, less one.",
        ),
    ),
    needs=("~distance_m", "force_N|flux_linkage_Wb|hall_V"),
    experiment="Read the stage over two gauge blocks, the shortest and the longest that fit.",
    reference="Linear error of a stage; ISO 230-2 (2014)",
    setting=_setting,
    calibrations=(
        Calibration(
            {"scale_error": 1e-3},
            20.0,
            "Read the stage over two gauge blocks, the shortest and the longest that fit.",
        ),
    ),
)
"""True distance = (1 + scale error) recorded distance."""
