"""The stage's zero is not where the model counts distances from."""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters


def _setting(d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters) -> tuple[FloatArray, FloatArray]:
    return d + p["offset_m"], i


DISTANCE_OFFSET = Effect(
    name="distance_offset",
    symptom="Every channel looks as if measured at another distance, the same amount everywhere.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            name="offset_m",
            unit="m",
            lower=-5e-3,
            upper=5e-3,
            plausible=(-1e-3, 1e-3),
            description="True minus recorded distance.",
        ),
    ),
    needs=("distance_m", "force_N|flux_linkage_Wb|hall_V"),
    experiment="Touch the face with a gauge block of known height and read the stage; or measure where the force "
    "gradient is largest, at two currents.",
    reference="First-order error of a stage's zero; JCGM 100:2008 (GUM), section 3.2.4",
    setting=_setting,
    calibrations=(
        Calibration(
            {"offset_m": 1e-5},
            10.0,
            "Rest the moving part on a gauge block of known height and compare the stage's reading.",
        ),
    ),
)
"""True distance = recorded distance + offset."""
