"""The fluxmeter's integrator drifts from the start of each run, when it was reset."""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters, in_channel

_STILL = "Leave everything still and read the fluxmeter for as long as a run takes."


def _drifted(flux: FloatArray, conditions: Conditions, p: Parameters) -> FloatArray:
    """With what an integrated offset, and one that drifts itself, have become since the run's start."""
    time = conditions.time_s / 1000.0
    return flux + conditions.nominal.flux_linkage_Wb * (p["ramp"] * time + p["bend"] * time**2)


FLUX_INTEGRATOR_DRIFT = Effect(
    name="flux_integrator_drift",
    symptom="The flux linkage wanders off from the start of each run; force and Hall voltage do not.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "ramp",
            bounds=(-100.0, 100.0),
            plausible=(-0.5, 0.5),
            description="Drift over 1000 readings (or seconds) of a run, as a part of the largest flux linkage.",
            words="the fluxmeter drifts by {signed} in 1000 readings or seconds",
            scale="flux_linkage_Wb",
        ),
        EffectParameter(
            "bend",
            bounds=(-100.0, 100.0),
            plausible=(-0.5, 0.5),
            description="The same, growing with the square of the time, as the offset itself drifts.",
            words="its drift grows by {signed} in the first 1000",
            scale="flux_linkage_Wb",
        ),
    ),
    needs=("flux_linkage_Wb", "~order|~time_s"),
    experiment=_STILL,
    reference="Fiorillo, Characterization and Measurement of Magnetic Materials (2004), section 5.1",
    readings=in_channel("flux_linkage_Wb", _drifted),
    calibrations=(Calibration({"ramp": 1e-3, "bend": 1e-3}, 60.0, _STILL),),
)
