"""The magnet has lost a part of its magnetisation for good: all over, or in the layer next to its face.

A magnet of height t without its layer of thickness l is a magnet weaker by l/t, whose middle lies l/2 further away.
"""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters
from femfit.effects.remanence import remanence_scaled
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries


def _coenergy(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    lost = p["layer_m"] / p["magnet_height_m"]
    return remanence_scaled(base, (1.0 - p["loss"]) * (1.0 - lost), d + 0.5 * p["layer_m"], i, n_d, n_i)


MAGNET_DEMAGNETISATION = Effect(
    name="magnet_demagnetisation",
    symptom="The magnet's share of force, flux linkage and Hall voltage is too small everywhere, at any temperature.",
    acts_on=("magnetics",),
    parameters=(
        EffectParameter(
            "loss",
            "",
            bounds=(-0.1, 0.8),
            plausible=(-0.03, 0.3),
            description="Lost part of the remanence; negative for a magnet that is stronger than its grade.",
            words="the magnet has {lost|gained} {size} of its remanence",
        ),
        EffectParameter(
            "layer_m",
            "m",
            bounds=(0.0, 2e-3),
            plausible=(0.0, 1e-3),
            description="Thickness of the demagnetised layer next to the face.",
            words="a layer of {size} at the magnet's face is demagnetised",
        ),
        EffectParameter(
            "magnet_height_m",
            "m",
            bounds=(3e-3, 0.05),
            plausible=(3e-3, 0.02),
            description="Height of the whole magnet.",
            null=5e-3,
            nonlinear=True,
        ),
    ),
    needs=("force_N|flux_linkage_Wb|hall_V", "magnet"),
    experiment="Compare the magnet's field on its axis, out of the bench, with that of a fresh one; or measure at both "
    "signs of the current, where the coil's own share is the same.",
    reference="Campbell, Permanent Magnet Materials and their Application (1994), chapter 3",
    coenergy=_coenergy,
    calibrations=(
        Calibration(
            {"layer_m": 5e-5}, 40.0, "Take the magnet out and compare its field at both faces by a gaussmeter."
        ),
        Calibration(
            {"loss": 5e-3},
            200.0,
            "Have the magnet magnetised anew, and read its field by a gaussmeter before and after.",
        ),
    ),
)
