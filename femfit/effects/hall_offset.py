"""The Hall element's quiescent voltage is not the model's: recorded voltage = expected voltage + offset."""

from femfit.effects.effect import Calibration, Effect, EffectParameter, in_channel

HALL_OFFSET = Effect(
    name="hall_offset",
    symptom="The Hall voltage is wrong by the same amount everywhere; force and flux linkage are right.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "offset_V",
            "V",
            bounds=(-1.0, 1.0),
            plausible=(-0.1, 0.1),
            description="Recorded minus expected voltage.",
            words="the Hall voltage is {size} too {high|low}",
        ),
    ),
    needs=("hall_V",),
    experiment="Remove the moving part, switch the current off and read the Hall voltage.",
    reference="E. Ramsden, Hall-Effect Sensors (Newnes, 2006), chapter 2",
    readings=in_channel("hall_V", lambda volts, conditions, p: volts + p["offset_V"]),
    calibrations=(
        Calibration({"offset_V": 1e-3}, 15.0, "Put the Hall element into a zero-gauss chamber and read its voltage."),
    ),
)
