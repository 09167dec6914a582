"""The Hall element's offset and sensitivity grow linearly with its temperature.

Its temperature is rarely recorded: it lies between that of the coil, on whose face it sits, and that of the magnet's
surroundings, at a share that is a nonlinear parameter.
"""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C, Conditions, known_or
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters, in_channel


def _warmed(volts: FloatArray, conditions: Conditions, p: Parameters) -> FloatArray:
    coil, magnet = (
        known_or(temperature, volts, REFERENCE_TEMPERATURE_C) - REFERENCE_TEMPERATURE_C
        for temperature in (conditions.coil_temperature_C, conditions.magnet_temperature_C)
    )
    warmer = p["coil_share"] * coil + (1.0 - p["coil_share"]) * magnet
    swing = volts - conditions.nominal.hall_quiescent_V
    return volts + warmer * (p["offset_V_per_K"] + p["sensitivity_per_K"] * swing)


HALL_TEMPERATURE = Effect(
    name="hall_temperature",
    symptom="The Hall voltage goes with the temperature; force and flux linkage do not.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "offset_V_per_K",
            "V/K",
            bounds=(-0.1, 0.1),
            plausible=(-5e-3, 5e-3),
            description="Change of the quiescent voltage per kelvin.",
            words="the Hall voltage at no field changes by {signed}",
        ),
        EffectParameter(
            "sensitivity_per_K",
            "1/K",
            bounds=(-0.02, 0.02),
            plausible=(-3e-3, 3e-3),
            description="Relative change of the sensitivity per kelvin.",
            words="the Hall element's sensitivity changes by {signed}",
        ),
        EffectParameter(
            "coil_share",
            "",
            bounds=(0.0, 1.0),
            plausible=(0.0, 1.0),
            description="How far the element's temperature follows the coil's instead of the magnet's.",
            words="its temperature follows the winding's by {size}",
            null=1.0,
            nonlinear=True,
        ),
    ),
    needs=("hall_V", "~coil_temperature_C|~magnet_temperature_C"),
    experiment="Warm the coil by a steady current, switch it off and read the Hall voltage while it cools.",
    reference="Popovic, Hall Effect Devices (2004), sections 4.8 and 5.6; Allegro A1321 data sheet",
    readings=in_channel("hall_V", _warmed),
    calibrations=(
        Calibration(
            {"offset_V_per_K": 5e-5, "sensitivity_per_K": 5e-5},
            60.0,
            "Warm the Hall element by 30 K, in a zero-gauss chamber and then over a fixed magnet, and read its "
            "voltage.",
        ),
    ),
)
