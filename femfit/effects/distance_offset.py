"""The stage's zero is not where the model counts distances from: true distance = recorded distance + offset."""

from femfit.effects.effect import Calibration, Effect, EffectParameter

DISTANCE_OFFSET = Effect(
    name="distance_offset",
    symptom="Every channel looks as if measured at another distance, the same amount everywhere.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            "offset_m",
            "m",
            bounds=(-5e-3, 5e-3),
            plausible=(-1e-3, 1e-3),
            description="True minus recorded distance.",
            words="the gap is {size} {larger|smaller} than recorded",
        ),
    ),
    needs=("distance_m", "force_N|flux_linkage_Wb|hall_V"),
    experiment="Touch the face with a gauge block of known height and read the stage; or measure where the force "
    "gradient is largest, at two currents.",
    reference="First-order error of a stage's zero; JCGM 100:2008 (GUM), section 3.2.4",
    setting=lambda d, i, conditions, p: (d + p["offset_m"], i),
    calibrations=(
        Calibration(
            {"offset_m": 1e-5},
            10.0,
            "Rest the moving part on a thin gauge block of known height and compare the stage's reading.",
            also={"distance_scale": {"scale_error": 1e-3}},  # a block of 1 mm
        ),
    ),
)
