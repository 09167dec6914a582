"""The ammeter's scale is wrong."""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters


def _setting(d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters) -> tuple[FloatArray, FloatArray]:
    return d, (1.0 + p["gain_error"]) * i


CURRENT_GAIN = Effect(
    name="current_gain",
    symptom="Every channel looks as if the current were another, by the same percentage.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            name="gain_error",
            unit="",
            lower=-0.9,
            upper=2.0,
            plausible=(-0.1, 0.1),
            description="True over recorded current, less one.",
        ),
    ),
    needs=("~current_A", "force_N|flux_linkage_Wb|hall_V|voltage_V"),
    experiment="Read the current with a calibrated shunt in series.",
    reference="JCGM 100:2008 (GUM), section 4.3",
    setting=_setting,
    calibrations=(
        Calibration(
            {"gain_error": 1e-3},
            20.0,
            "Put a calibrated shunt in series and compare the ammeter's reading.",
        ),
    ),
)
"""True current = (1 + gain error) recorded current."""
