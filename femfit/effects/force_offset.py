"""The force sensor does not read zero without a force: recorded force = true force + offset."""

from femfit.effects.effect import Calibration, Effect, EffectParameter, in_channel

_UNLOADED = "Take everything off the force sensor, and read it."

FORCE_OFFSET = Effect(
    name="force_offset",
    symptom="Every force is wrong by the same amount, also far away and without current.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "offset",
            "",
            bounds=(-1.0, 1.0),
            plausible=(-0.05, 0.05),
            description="Recorded minus true force, as a part of the largest force.",
            words="the force sensor reads {size} too {much|little}",
            scale="force_N",
        ),
    ),
    needs=("force_N",),
    experiment=_UNLOADED,
    reference="JCGM 100:2008 (GUM), section 3.2.4",
    readings=in_channel("force_N", lambda force, conditions, p: force + p["offset"] * conditions.nominal.force_N),
    calibrations=(Calibration({"offset": 1e-3}, 10.0, _UNLOADED),),
)
