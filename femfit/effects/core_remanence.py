"""The core keeps a flux when the current is gone: W'(d, i) -> W'(d, i + i_r), without a voltage across the winding.

Steel that was magnetised acts as a further winding whose ampere turns are its coercive field times its length; over a
path with a gap they change little until the current is turned round (a loop that follows it is ``hysteresis``).
"""

from femfit.effects.effect import Calibration, Effect, EffectParameter

CORE_REMANENCE = Effect(
    name="core_remanence",
    symptom="Force and flux linkage remain without current, and differ between the two signs of a current.",
    acts_on=("magnetics",),
    parameters=(
        EffectParameter(
            "mmf",
            bounds=(-1.0, 1.0),
            plausible=(-0.05, 0.05),
            description="Ampere turns that the core keeps, as a part of those of the largest current.",
            words="the core keeps a flux as {signed} in the winding would drive it",
            scale="peak_current_A",
        ),
    ),
    needs=("force_N|flux_linkage_Wb|inductance_H", "iron"),
    experiment="Demagnetise the core by a slowly falling alternating current, and measure again.",
    reference="Bozorth, Ferromagnetism (1993), chapter 19 (remanence of a circuit with a gap)",
    coenergy=lambda base, d, i, n_d, n_i, conditions, p: base(
        d, i + p["mmf"] * conditions.nominal.peak_current_A, n_d, n_i
    ),
    calibrations=(
        Calibration(
            {"mmf": 2e-3},
            30.0,
            "Read the field at the core's face without current, before and after demagnetising it.",
        ),
    ),
)
