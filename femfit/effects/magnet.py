"""What weakens a magnet: warmth, or a lost part of its magnetisation, all over or in the layer next to its face.

Warm: remanence = (1 + coefficient (T - 20 °C) + curvature (T - 20 °C)^2) of the base's. Demagnetised: a magnet of
height t without its layer of thickness l is a magnet weaker by l/t, whose middle lies l/2 further away.

A uniform field from elsewhere: the earth's, a motor's, a magnetised table's.

It adds to the field at the Hall element, and magnetises a soft core as a current would, which changes force and flux
linkage as well: W'(d, i, h) -> W'(d, i + i_e, h) + h B_e, with i_e = share B_e / (field at the element per ampere).
"""

import numpy as np

from femfit.core.graph import Expression
from femfit.effects.circuit import remanence_scaled
from femfit.effects.conditions import Conditions, warmth
from femfit.effects.effect import Calibration, Coenergy, Effect, EffectParameter, Parameters

USUAL_COEFFICIENT = -1.1e-3
"""Relative change of NdFeB's remanence per kelvin, by which an unrecorded warming is counted (IEC 60404-8-1)."""

_LEAST = 0.05
"""Part of the remanence that is left, whatever a fit tries."""


def _warm(
    base: Coenergy, d: Expression, i: Expression, h: Expression, conditions: Conditions, p: Parameters
) -> Expression:
    magnet, coil = warmth(conditions.magnet_temperature_C), warmth(conditions.coil_temperature_C)
    known = p["coefficient_per_K"] * magnet.kelvin + p["curvature_per_K2"] * magnet.kelvin**2
    unrecorded = USUAL_COEFFICIENT * (p["warmer_K"] + p["coil_share"] * coil.kelvin)
    scale = 1.0 + known + (1.0 if conditions.running else magnet.unknown) * unrecorded
    return remanence_scaled(base, np.maximum(scale, _LEAST), d, i, h)


MAGNET_TEMPERATURE = Effect(
    name="magnet_temperature",
    symptom="Force, flux linkage and Hall voltage shrink together in the magnet's share as it gets warm.",
    parameters=(
        EffectParameter(
            "coefficient_per_K",
            unit="1/K",
            bounds=(-0.01, 0.005),
            plausible=(-3e-3, 0.0),
            description="Relative change of the remanence per kelvin of the recorded temperature over 20 °C.",
            words="the remanence {grows|falls} by {size} of the recorded temperature",
        ),
        EffectParameter(
            "curvature_per_K2",
            unit="1/K^2",
            bounds=(-1e-4, 1e-4),
            plausible=(-1e-5, 1e-5),
            description="The same per kelvin squared.",
            words="it {grows|falls} by {size} besides",
        ),
        EffectParameter(
            "warmer_K",
            unit="K",
            bounds=(-60.0, 150.0),
            plausible=(-10.0, 60.0),
            description="Where its temperature was not recorded: the magnet's over 20 °C, by -0.11 % a kelvin.",
            words="the magnet is {size} {warmer|colder} than 20 °C",
        ),
        EffectParameter(
            "coil_share",
            bounds=(0.0, 2.0),
            plausible=(0.0, 1.0),
            description="Where its temperature was not recorded: the part of the coil's warming that it follows.",
            words="the magnet follows {size} of the winding's warming",
        ),
    ),
    needs=("force_N|flux_linkage_Wb|inductance_H|hall_V", "magnet"),
    experiment="Measure the same settings with the magnet cold and after warming it by 20 K, its temperature recorded.",
    reference="IEC 60404-8-1; Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=_warm,
    calibrations=(
        Calibration(
            {"warmer_K": 2.0, "coil_share": 0.1},
            15.0,
            "Put thermometers on magnet and winding, and read them while the bench runs.",
        ),
    ),
)


def _demagnetised(
    base: Coenergy,
    d: Expression,
    i: Expression,
    h: Expression,
    conditions: Conditions,
    p: Parameters,
) -> Expression:
    lost = p["layer_m"] / p["magnet_height_m"]
    return remanence_scaled(base, (1.0 - p["loss"]) * (1.0 - lost), d + 0.5 * p["layer_m"], i, h)


MAGNET_DEMAGNETISATION = Effect(
    name="magnet_demagnetisation",
    symptom="The magnet's share of force, flux linkage and Hall voltage is too small everywhere, at any temperature.",
    parameters=(
        EffectParameter(
            "loss",
            bounds=(-0.1, 0.8),
            plausible=(-0.03, 0.3),
            description="Lost part of the remanence; negative for a magnet that is stronger than its grade.",
            words="the magnet has {lost|gained} {size} of its remanence",
        ),
        EffectParameter(
            "layer_m",
            unit="m",
            bounds=(0.0, 2e-3),
            plausible=(0.0, 1e-3),
            description="Thickness of the demagnetised layer next to the face.",
            words="a layer of {size} at the magnet's face is demagnetised",
        ),
        EffectParameter(
            "magnet_height_m",
            unit="m",
            bounds=(3e-3, 0.05),
            plausible=(3e-3, 0.02),
            description="Height of the whole magnet.",
            null=5e-3,
            nonlinear=True,
        ),
    ),
    needs=("force_N|flux_linkage_Wb|inductance_H|hall_V", "magnet"),
    experiment="Compare the magnet's field on its axis, out of the bench, with that of a fresh one; or measure at both "
    "signs of the current, where the coil's own share is the same.",
    reference="Campbell, Permanent Magnet Materials and their Application (1994), chapter 3",
    coenergy=_demagnetised,
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


def _coenergy(
    base: Coenergy, d: Expression, i: Expression, h: Expression, conditions: Conditions, p: Parameters
) -> Expression:
    equivalent = p["core_share"] * p["field_T"] / conditions.nominal.hall_T_per_A
    return base(d, i + equivalent, h) + h * p["field_T"]


EXTERNAL_FIELD = Effect(
    name="external_field",
    symptom="The Hall voltage is wrong by a constant, and force and flux linkage as if a small current were added.",
    parameters=(
        EffectParameter(
            "field_T",
            unit="T",
            bounds=(-0.05, 0.05),
            plausible=(-2e-3, 2e-3),
            description="Uniform field along the axis.",
            words="a field of {signed} from elsewhere acts along the axis",
        ),
        EffectParameter(
            "core_share",
            bounds=(0.05, 2.0),
            plausible=(0.05, 0.6),
            description="Field at the Hall element that the core adds to it, over the field itself.",
            null=0.25,
            nonlinear=True,
        ),
    ),
    needs=("hall_V", "force_N|flux_linkage_Wb"),
    experiment="Turn the whole bench by 180 degrees about a horizontal axis, the current off, and read the Hall "
    "voltage in both positions.",
    reference="Bozorth, Ferromagnetism (1993), chapter 19 (a body in a uniform field)",
    coenergy=_coenergy,
    calibrations=(
        Calibration(
            {"field_T": 2e-5},
            15.0,
            "Switch the current off, take the moving part away and turn the bench by 180 degrees: half the "
            "change of the Hall voltage is the outer field's.",
        ),
    ),
)
