"""The stage's scale is wrong (pitch, lever's ratio): true distance = (1 + scale error) recorded distance.

Stages are zeroed where the parts touch, so the scale acts about the distance 0, not about the middle of the table.
"""

from femfit.effects.effect import Calibration, Effect, EffectParameter

_GAUGE_BLOCKS = "Read the stage over two gauge blocks, the shortest and the longest that fit."

DISTANCE_SCALE = Effect(
    name="distance_scale",
    symptom="Every channel looks as if measured at another distance, the more so the further away.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            "scale_error",
            "",
            bounds=(-0.3, 0.3),
            plausible=(-0.05, 0.05),
            description="True over recorded distance, less one.",
            words="distances are {size} {larger|smaller} than recorded",
        ),
    ),
    needs=("~distance_m", "force_N|flux_linkage_Wb|hall_V"),
    experiment=_GAUGE_BLOCKS,
    reference="Linear error of a stage; ISO 230-2 (2014)",
    setting=lambda d, i, conditions, p: ((1.0 + p["scale_error"]) * d, i),
    calibrations=(Calibration({"scale_error": 1e-3}, 20.0, _GAUGE_BLOCKS),),
)
