"""The Hall element's output drifts with time: a ramp, or a warm-up that settles; over the campaign or anew each run."""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters, in_channel

_UNIT_OF_TIME = 1000.0
"""Ramps count in thousands of readings, or of seconds where the data have a clock."""


def _drifted(volts: FloatArray, conditions: Conditions, p: Parameters) -> FloatArray:
    elapsed, run_time = like(conditions.elapsed, volts), like(conditions.time_s, volts)
    ramps = (p["ramp_V"] * elapsed + p["run_ramp_V"] * run_time) / _UNIT_OF_TIME
    settled = [-np.expm1(-time / p["settling_time"]) for time in (elapsed, run_time)]
    return np.asarray(volts + ramps + p["settling_V"] * settled[0] + p["run_settling_V"] * settled[1])


def _amplitude(name: str, largest: float, description: str, words: str) -> EffectParameter:
    return EffectParameter(
        name,
        "V",
        bounds=(-100.0 * largest, 100.0 * largest),
        plausible=(-largest, largest),
        description=description,
        words=words,
    )


HALL_DRIFT = Effect(
    name="hall_drift",
    symptom="The Hall voltage wanders with time, whatever the distance and current.",
    acts_on=("sensor",),
    parameters=(
        _amplitude(
            "ramp_V",
            0.2,
            "Drift over 1000 readings (or seconds) of the campaign.",
            "the Hall voltage drifts by {signed} in 1000 readings or seconds of the campaign",
        ),
        _amplitude(
            "run_ramp_V",
            0.2,
            "Drift over 1000 readings (or seconds) of a run, zero at its start.",
            "the Hall voltage drifts by {signed} in 1000 readings or seconds of each run",
        ),
        _amplitude(
            "settling_V",
            0.1,
            "Final drift of a warm-up that begins with the campaign.",
            "the Hall voltage settles by {signed} from the start of the campaign",
        ),
        _amplitude(
            "run_settling_V",
            0.1,
            "Final drift of a warm-up that begins with each run.",
            "the Hall voltage settles by {signed} from the start of each run",
        ),
        EffectParameter(
            "settling_time",
            "",
            bounds=(1.0, 1e4),
            plausible=(20.0, 500.0),
            description="Readings (or seconds) after which 63 % of a warm-up are over.",
            null=100.0,
            nonlinear=True,
        ),
    ),
    needs=("hall_V", "~elapsed"),
    experiment="Come back to one distance and current every few minutes and read the Hall voltage.",
    reference="Popovic, Hall Effect Devices (2004), section 5.6 (offset drift)",
    readings=in_channel("hall_V", _drifted),
    calibrations=(
        Calibration(
            {"ramp_V": 5e-3, "run_ramp_V": 5e-3, "settling_V": 2e-3, "run_settling_V": 2e-3},
            60.0,
            "Read the Hall voltage at one distance and current, switched on anew, for as long as the campaign took.",
        ),
    ),
)
