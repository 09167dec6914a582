"""The fluxmeter's integrator drifts from the start of each run, when it was reset."""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters, in_channel

_STILL = "Leave everything still and read the fluxmeter for as long as a run takes."


def _drifted(flux: FloatArray, conditions: Conditions, p: Parameters) -> FloatArray:
    """With what an integrated offset, and one that drifts itself over the campaign, have become since the run's start.

    Of the offset o + o' T at the time T of the campaign, the integral from a run's start T_0 to T_0 + t is
    o t + o' (t^2 + 2 T_0 t) / 2.
    """
    time = conditions.time_s / 1000.0
    start = conditions.elapsed / 1000.0 - time
    drift = p["ramp"] * time + p["bend"] * time * (time + 2.0 * start)
    return flux + conditions.nominal.flux_linkage_Wb * drift


FLUX_INTEGRATOR_DRIFT = Effect(
    name="flux_integrator_drift",
    symptom="The flux linkage wanders off from the start of each run; force and Hall voltage do not.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "ramp",
            bounds=(-100.0, 100.0),
            plausible=(-0.5, 0.5),
            description="Drift over the first 1000 readings (or seconds), as a part of the largest flux linkage.",
            words="the fluxmeter drifts by {signed} in 1000 readings or seconds",
            scale="flux_linkage_Wb",
        ),
        EffectParameter(
            "bend",
            bounds=(-100.0, 100.0),
            plausible=(-0.5, 0.5),
            description="What it grows by in that time, as the offset itself drifts from run to run.",
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
