"""The Hall element's output drifts with time: a ramp, or a warm-up that settles; over the campaign or anew each run.

References
----------
R. S. Popovic, Hall Effect Devices, 2nd ed. (IOP, 2004), section 5.6 (offset drift).
"""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters, with_channel

_UNIT_OF_TIME = 1000.0
"""Ramps count in thousands of readings, or of seconds where the data have a clock."""


def _readings(
    values: Mapping[str, FloatArray], d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters
) -> Mapping[str, FloatArray]:
    elapsed, run_time = like(conditions.elapsed, d), like(conditions.time_s, d)
    drift = (p["ramp_V"] * elapsed + p["run_ramp_V"] * run_time) / _UNIT_OF_TIME
    settled = [-np.expm1(-time / p["settling_time"]) for time in (elapsed, run_time)]
    drift = drift + p["settling_V"] * settled[0] + p["run_settling_V"] * settled[1]
    return with_channel(values, "hall_V", lambda volts: volts + drift)


def _amplitude(name: str, reach: float, description: str) -> EffectParameter:
    return EffectParameter(
        name=name,
        unit="V",
        lower=-100.0 * reach,
        upper=100.0 * reach,
        plausible=(-reach, reach),
        description=description,
    )


HALL_DRIFT = Effect(
    name="hall_drift",
    symptom="The Hall voltage wanders with time, whatever the distance and current.",
    acts_on=("sensor",),
    parameters=(
        _amplitude("ramp_V", 0.2, "Drift over 1000 readings (or seconds) of the campaign."),
        _amplitude("run_ramp_V", 0.2, "Drift over 1000 readings (or seconds) of a run, zero at its start."),
        _amplitude("settling_V", 0.1, "Final drift of a warm-up that begins with the campaign."),
        _amplitude("run_settling_V", 0.1, "Final drift of a warm-up that begins with each run."),
        EffectParameter(
            name="settling_time",
            unit="",
            lower=1.0,
            upper=1e4,
            plausible=(20.0, 500.0),
            description="Readings (or seconds) after which 63 % of a warm-up are over.",
            null=100.0,
            nonlinear=True,
        ),
    ),
    needs=("hall_V", "~elapsed"),
    experiment="Come back to one distance and current every few minutes and read the Hall voltage.",
    reference="Popovic, Hall Effect Devices (2004), section 5.6",
    readings=_readings,
    calibrations=(
        Calibration(
            {"ramp_V": 5e-3, "run_ramp_V": 5e-3, "settling_V": 2e-3, "run_settling_V": 2e-3},
            60.0,
            "Read the Hall voltage at one distance and current, switched on anew, for as long as the campaign took.",
        ),
    ),
)
"""Recorded voltage = expected voltage + ramp and warm-up."""
