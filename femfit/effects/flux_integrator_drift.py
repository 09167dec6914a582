"""The fluxmeter's integrator drifts from the start of each run, when it was reset.

References
----------
A. Fiorillo, Characterization and Measurement of Magnetic Materials (Elsevier, 2004), section 5.1 (integrator drift).
"""

from collections.abc import Mapping

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters, with_channel


def _readings(
    values: Mapping[str, FloatArray], d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters
) -> Mapping[str, FloatArray]:
    time = like(conditions.time_s, d) / 1000.0
    drift = conditions.nominal.flux_linkage_Wb * (p["ramp"] * time + p["bend"] * time**2)
    return with_channel(values, "flux_linkage_Wb", lambda flux: flux + drift)


FLUX_INTEGRATOR_DRIFT = Effect(
    name="flux_integrator_drift",
    symptom="The flux linkage wanders off from the start of each run; force and Hall voltage do not.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            name="ramp",
            unit="",
            lower=-100.0,
            upper=100.0,
            plausible=(-0.5, 0.5),
            description="Drift over 1000 readings (or seconds) of a run, as a part of the largest flux linkage.",
            scale="flux_linkage_Wb",
        ),
        EffectParameter(
            name="bend",
            unit="",
            lower=-100.0,
            upper=100.0,
            plausible=(-0.5, 0.5),
            description="The same, growing with the square of the time, as the offset itself drifts.",
            scale="flux_linkage_Wb",
        ),
    ),
    needs=("flux_linkage_Wb", "~order|~time_s"),
    experiment="Leave everything still and read the fluxmeter for as long as a run takes.",
    reference="Fiorillo, Characterization and Measurement of Magnetic Materials (2004), section 5.1",
    readings=_readings,
    calibrations=(
        Calibration(
            {"ramp": 1e-3, "bend": 1e-3},
            60.0,
            "Leave everything still and read the fluxmeter for as long as a run takes.",
        ),
    ),
)
"""Recorded flux linkage = expected flux linkage + what an integrated offset has become since the run's start."""
