"""The force sensor's scale is wrong."""

from collections.abc import Mapping

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters, with_channel


def _readings(
    values: Mapping[str, FloatArray], d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters
) -> Mapping[str, FloatArray]:
    return with_channel(values, "force_N", lambda force: (1.0 + p["gain_error"]) * force)


FORCE_GAIN = Effect(
    name="force_gain",
    symptom="Every force is wrong by the same percentage; flux linkage and Hall voltage are right.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            name="gain_error",
            unit="",
            lower=-0.9,
            upper=2.0,
            plausible=(-0.1, 0.1),
            description="Recorded over true force, less one.",
        ),
    ),
    needs=("force_N",),
    experiment="Hang a reference weight on the force sensor and compare its reading.",
    reference="JCGM 100:2008 (GUM), section 4.3; OIML R 111-1 (2004) for the weight",
    readings=_readings,
    calibrations=(
        Calibration(
            {"gain_error": 1e-3},
            20.0,
            "Hang a reference weight on the force sensor and compare its reading.",
        ),
    ),
)
"""Recorded force = (1 + gain error) true force."""
