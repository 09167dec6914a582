"""The Hall element's quiescent voltage is not the model's."""

from collections.abc import Mapping

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters


def _readings(
    values: Mapping[str, FloatArray], d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters
) -> Mapping[str, FloatArray]:
    return {**values, "hall_V": values["hall_V"] + p["offset_V"]} if "hall_V" in values else values


HALL_OFFSET = Effect(
    name="hall_offset",
    symptom="The Hall voltage is wrong by the same amount everywhere; force and flux linkage are right.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            name="offset_V",
            unit="V",
            lower=-1.0,
            upper=1.0,
            plausible=(-0.1, 0.1),
            description="Recorded minus expected voltage.",
        ),
    ),
    needs=("hall_V",),
    experiment="Remove the moving part, switch the current off and read the Hall voltage.",
    reference="E. Ramsden, Hall-Effect Sensors (Newnes, 2006), chapter 2",
    readings=_readings,
    calibrations=(
        Calibration({"offset_V": 1e-3}, 15.0, "Put the Hall element into a zero-gauss chamber and read its voltage."),
    ),
)
"""Recorded voltage = expected voltage + offset."""
