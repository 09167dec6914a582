"""The coil's leads and their supply disturb the Hall reading: in step with the current, and with its rate.

References
----------
H. W. Ott, Electromagnetic Compatibility Engineering (Wiley, 2009), chapters 2 (inductive coupling) and 3
(common ground).
"""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Memory, Parameters, with_channel


def _readings(
    values: Mapping[str, FloatArray], d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters
) -> Mapping[str, FloatArray]:
    part = i / conditions.nominal.current_scale
    if "pickup_lag" in conditions.memory:
        rate = conditions.memory["pickup_lag"] / conditions.nominal.sample_time_s
    else:
        rate = like(conditions.current_rate_A_s, i) / conditions.nominal.current_scale
    return with_channel(values, "hall_V", lambda volts: volts + p["pickup_V"] * part + p["induced_V_s"] * rate)


def _steady_state(d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters) -> Mapping[str, FloatArray]:
    return {"pickup_lag": np.zeros_like(i)}


def _rate(
    states: Mapping[str, FloatArray],
    d: FloatArray,
    v: FloatArray,
    i: FloatArray,
    current_rate: FloatArray,
    conditions: Conditions,
    p: Parameters,
) -> Mapping[str, FloatArray]:
    """The current less its mean over about one sample: the current's rate, for what knows no voltage."""
    return {
        "pickup_lag": current_rate / conditions.nominal.current_scale
        - states["pickup_lag"] / conditions.nominal.sample_time_s
    }


HALL_COIL_PICKUP = Effect(
    name="hall_coil_pickup",
    symptom="The Hall voltage has a further part in step with the current; force and flux linkage are right.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            name="pickup_V",
            unit="V",
            lower=-5.0,
            upper=5.0,
            plausible=(-0.3, 0.3),
            description="Further voltage at the largest current.",
        ),
        EffectParameter(
            name="induced_V_s",
            unit="V s",
            lower=-0.1,
            upper=0.1,
            plausible=(-1e-3, 1e-3),
            description="Further voltage while the current changes by its largest value in a second.",
        ),
    ),
    needs=("~current_A", "hall_V"),
    experiment="Take the moving part away and read the Hall voltage at both signs of the current, with its leads laid "
    "in two ways.",
    reference="Ott, Electromagnetic Compatibility Engineering (2009), chapters 2 and 3",
    readings=_readings,
    memory=Memory(
        names=("pickup_lag",), amplitudes=("induced_V_s",), spread=0.01, steady_state=_steady_state, rate=_rate
    ),
    calibrations=(
        Calibration(
            {"pickup_V": 2e-3},
            20.0,
            "Take the moving part away and read the Hall voltage at the largest current of each sign.",
        ),
    ),
)
"""Recorded voltage = expected voltage + pick-up in step with the current and its rate."""
