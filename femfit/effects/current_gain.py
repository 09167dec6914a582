"""The ammeter's scale is wrong: true current = (1 + gain error) recorded current."""

from femfit.effects.effect import Calibration, Effect, EffectParameter

CURRENT_GAIN = Effect(
    name="current_gain",
    symptom="Every channel looks as if the current were another, by the same percentage.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            "gain_error",
            "",
            bounds=(-0.9, 2.0),
            plausible=(-0.1, 0.1),
            description="True over recorded current, less one.",
            words="the true current is {size} {larger|smaller} than the ammeter's reading",
        ),
    ),
    needs=("~current_A", "force_N|flux_linkage_Wb|hall_V|voltage_V"),
    experiment="Read the current with a calibrated shunt in series.",
    reference="JCGM 100:2008 (GUM), section 4.3",
    setting=lambda d, i, conditions, p: (d, (1.0 + p["gain_error"]) * i),
    calibrations=(
        Calibration({"gain_error": 1e-3}, 20.0, "Put a calibrated shunt in series and compare the ammeter's reading."),
    ),
)
