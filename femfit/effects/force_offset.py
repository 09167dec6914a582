"""The force sensor does not read zero without a force."""

from collections.abc import Mapping

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters, with_channel


def _readings(
    values: Mapping[str, FloatArray], d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters
) -> Mapping[str, FloatArray]:
    return with_channel(values, "force_N", lambda force: force + p["offset"] * conditions.nominal.force_N)


FORCE_OFFSET = Effect(
    name="force_offset",
    symptom="Every force is wrong by the same amount, also far away and without current.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            name="offset",
            unit="",
            lower=-1.0,
            upper=1.0,
            plausible=(-0.05, 0.05),
            description="Recorded minus true force, as a part of the largest force.",
            scale="force_N",
        ),
    ),
    needs=("force_N",),
    experiment="Take the electromagnet away and read the force sensor with nothing but the moving part on it.",
    reference="JCGM 100:2008 (GUM), section 3.2.4",
    readings=_readings,
    calibrations=(
        Calibration(
            {"offset": 1e-3},
            10.0,
            "Take the electromagnet away and read the force sensor with nothing but the moving part on it.",
        ),
    ),
)
"""Recorded force = true force + offset."""
