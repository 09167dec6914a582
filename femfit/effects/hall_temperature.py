"""The Hall element's offset and sensitivity change with its temperature.

Its temperature is rarely recorded: it lies between that of the coil, on whose face it sits, and that of the magnet's
surroundings, at a share that is a constant of the shape.

References
----------
R. S. Popovic, Hall Effect Devices, 2nd ed. (IOP, 2004), section 4.8 and 5.6; Allegro A1321 data sheet.
"""

from collections.abc import Mapping

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C, Conditions, known_or
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters, with_channel


def _readings(
    values: Mapping[str, FloatArray], d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters
) -> Mapping[str, FloatArray]:
    coil, magnet = (
        known_or(temperature, d, REFERENCE_TEMPERATURE_C) - REFERENCE_TEMPERATURE_C
        for temperature in (conditions.coil_temperature_C, conditions.magnet_temperature_C)
    )
    warmer = p["coil_share"] * coil + (1.0 - p["coil_share"]) * magnet
    quiescent = conditions.nominal.hall_quiescent_V

    def change(volts: FloatArray) -> FloatArray:
        return volts + warmer * (p["offset_V_per_K"] + p["sensitivity_per_K"] * (volts - quiescent))

    return with_channel(values, "hall_V", change)


HALL_TEMPERATURE = Effect(
    name="hall_temperature",
    symptom="The Hall voltage goes with the temperature; force and flux linkage do not.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            name="offset_V_per_K",
            unit="V/K",
            lower=-0.1,
            upper=0.1,
            plausible=(-5e-3, 5e-3),
            description="Change of the quiescent voltage per kelvin.",
        ),
        EffectParameter(
            name="sensitivity_per_K",
            unit="1/K",
            lower=-0.02,
            upper=0.02,
            plausible=(-3e-3, 3e-3),
            description="Relative change of the sensitivity per kelvin.",
        ),
        EffectParameter(
            name="coil_share",
            unit="",
            lower=0.0,
            upper=1.0,
            plausible=(0.0, 1.0),
            description="How far the element's temperature follows the coil's instead of the magnet's.",
            null=1.0,
            nonlinear=True,
        ),
    ),
    needs=("hall_V", "~coil_temperature_C|~magnet_temperature_C"),
    experiment="Warm the coil by a steady current, switch it off and read the Hall voltage while it cools.",
    reference="Popovic, Hall Effect Devices (2004), sections 4.8 and 5.6",
    readings=_readings,
    calibrations=(
        Calibration(
            {"offset_V_per_K": 5e-5, "sensitivity_per_K": 5e-5},
            60.0,
            "Warm the Hall element by 30 K, in a zero-gauss chamber and then over a fixed magnet, and read its "
            "voltage.",
        ),
    ),
)
"""Offset and sensitivity grow linearly with the temperature."""
