"""The force sensor's scale is wrong: recorded force = (1 + gain error) true force."""

from femfit.effects.effect import Calibration, Effect, EffectParameter, in_channel

_WEIGHT = "Hang a reference weight on the force sensor and compare its reading."

FORCE_GAIN = Effect(
    name="force_gain",
    symptom="Every force is wrong by the same percentage; flux linkage and Hall voltage are right.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "gain_error",
            "",
            bounds=(-0.9, 2.0),
            plausible=(-0.1, 0.1),
            description="Recorded over true force, less one.",
            words="the force sensor reads {size} too {much|little}",
        ),
    ),
    needs=("force_N",),
    experiment=_WEIGHT,
    reference="JCGM 100:2008 (GUM), section 4.3; OIML R 111-1 (2004) for the weight",
    readings=in_channel("force_N", lambda force, conditions, p: (1.0 + p["gain_error"]) * force),
    calibrations=(Calibration({"gain_error": 1e-3}, 20.0, _WEIGHT),),
)
