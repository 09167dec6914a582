"""The moving mass is not the model's: true mass = (1 + mass error) the model's."""

from femfit.effects.effect import Calibration, Effect, EffectParameter

MASS_ERROR = Effect(
    name="mass_error",
    symptom="The body hangs at another current and accelerates otherwise than the model's; bench readings are right.",
    acts_on=("motion",),
    parameters=(
        EffectParameter(
            "mass_error",
            "",
            bounds=(-0.9, 9.0),
            plausible=(-0.3, 0.3),
            description="True over the model's mass, less one.",
            words="the moving mass is {size} {larger|smaller} than in the model",
        ),
    ),
    needs=("time_s", "distance_m|hall_V"),
    experiment="Weigh the moving part with everything that moves with it.",
    reference="Newton's second law; H. Goldstein, Classical Mechanics (Addison-Wesley, 1980), section 1.1",
    mass=lambda mass, p: (1.0 + p["mass_error"]) * mass,
    calibrations=(Calibration({"mass_error": 1e-3}, 5.0, "Weigh the moving part on a balance."),),
)
