"""The ammeter does not read zero without a current: true current = recorded current + offset."""

from femfit.effects.effect import Calibration, Effect, EffectParameter

CURRENT_OFFSET = Effect(
    name="current_offset",
    symptom="Every channel looks as if a constant current were added to the recorded one.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            "offset",
            "",
            bounds=(-1.0, 1.0),
            plausible=(-0.05, 0.05),
            description="True minus recorded current, as a part of the largest current.",
            words="the true current is {size} {larger|smaller} than the ammeter's reading",
            scale="current_scale",
        ),
    ),
    needs=("current_A", "force_N|flux_linkage_Wb|hall_V|voltage_V"),
    experiment="Open the circuit and read the ammeter; or measure at both signs of the current.",
    reference="JCGM 100:2008 (GUM), section 3.2.4",
    setting=lambda d, i, conditions, p: (d, i + p["offset"] * conditions.nominal.current_scale),
    calibrations=(Calibration({"offset": 1e-3}, 5.0, "Open the circuit and read the ammeter at zero current."),),
)
