"""The coil's leads and their supply disturb the Hall reading: in step with the current, and with its rate."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Memory, Parameters, States


def _readings(
    values: Mapping[str, FloatArray], d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters
) -> Mapping[str, FloatArray]:
    if "hall_V" not in values:
        return values
    nominal = conditions.nominal
    if "pickup_lag" in conditions.memory:
        rate = conditions.memory["pickup_lag"] / nominal.sample_time_s
    else:
        rate = like(conditions.current_rate_A_s, i) / nominal.peak_current_A
    return {
        **values,
        "hall_V": values["hall_V"] + p["pickup_V"] * i / nominal.peak_current_A + p["induced_V_s"] * rate,
    }


def _rate(states: States, i: FloatArray, conditions: Conditions, p: Parameters) -> States:
    """The current less its mean over about one sample: the current's rate, for what knows no voltage."""
    nominal = conditions.nominal
    return {
        "pickup_lag": conditions.current_rate_A_s / nominal.peak_current_A
        - states["pickup_lag"] / nominal.sample_time_s
    }


HALL_COIL_PICKUP = Effect(
    name="hall_coil_pickup",
    symptom="The Hall voltage has a further part in step with the current; force and flux linkage are right.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "pickup_V",
            unit="V",
            bounds=(-5.0, 5.0),
            plausible=(-0.3, 0.3),
            description="Further voltage at the largest current.",
            words="the Hall voltage changes by {signed} at the largest current",
        ),
        EffectParameter(
            "induced_V_s",
            unit="V s",
            bounds=(-0.1, 0.1),
            plausible=(-1e-3, 1e-3),
            description="Further voltage while the current changes by its largest value in a second.",
            words="the leads induce {signed} in the Hall reading when the largest current is switched",
        ),
    ),
    needs=("~current_A", "hall_V"),
    experiment="Take the moving part away and read the Hall voltage at both signs of the current, with its leads laid "
    "in two ways.",
    reference="Ott, Electromagnetic Compatibility Engineering (2009), chapters 2 (coupling) and 3 (common ground)",
    readings=_readings,
    memory=Memory(
        names=("pickup_lag",),
        amplitudes=("induced_V_s",),
        spread=0.01,
        steady_state=lambda d, i, conditions, p: {"pickup_lag": np.zeros_like(i)},
        rate=_rate,
    ),
    calibrations=(
        Calibration(
            {"pickup_V": 2e-3},
            20.0,
            "Put the Hall element with its leads into a zero-gauss chamber and read it at the largest current of "
            "each sign.",
        ),
    ),
)
