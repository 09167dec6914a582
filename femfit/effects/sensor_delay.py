"""The Hall reading is late: a filter before the converter, the conversion itself, a bus.

To first order the reading belongs to the distance d - tau v and the current i - tau i'. What knows no voltage knows no
i'; there the current less its own lag stands for it, a state with the time constant tau, or one sample where tau is
shorter.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Memory, Parameters, States


def _hall_point(d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters) -> tuple[FloatArray, FloatArray]:
    delay = p["delay_s"]
    if "delay_lag" in conditions.memory:
        lag = conditions.nominal.peak_current_A * like(conditions.memory["delay_lag"], i)
        late = delay / _lag_time(conditions, p) * lag
    else:
        late = delay * like(conditions.current_rate_A_s, i)
    return d - delay * like(conditions.velocity_m_s, d), i - late


def _lag_time(conditions: Conditions, p: Parameters) -> float:
    return max(p["delay_s"], conditions.nominal.sample_time_s)


def _rate(states: States, i: FloatArray, conditions: Conditions, p: Parameters) -> States:
    change = conditions.current_rate_A_s / conditions.nominal.peak_current_A
    return {"delay_lag": change - states["delay_lag"] / _lag_time(conditions, p)}


SENSOR_DELAY = Effect(
    name="sensor_delay",
    symptom="The Hall voltage follows distance and current late; at rest it is right.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "delay_s",
            unit="s",
            bounds=(0.0, 0.05),
            plausible=(0.0, 5e-3),
            description="Age of what a reading shows.",
            words="the Hall reading is {size} late",
        ),
    ),
    needs=("time_s", "hall_V", "current_A|voltage_V|distance_m"),
    experiment="Hold the body, step the current and record both on one clock; or move it and record a second, fast "
    "distance sensor.",
    reference="Astrom and Wittenmark, Computer-Controlled Systems (1997), section 2.3 (delays)",
    hall_point=_hall_point,
    memory=Memory(
        names=("delay_lag",),
        amplitudes=("delay_s",),
        spread=0.02,
        steady_state=lambda d, i, conditions, p: {"delay_lag": np.zeros_like(i)},
        rate=_rate,
    ),
    calibrations=(
        Calibration(
            {"delay_s": 5e-5},
            40.0,
            "Feed a step from a signal generator in the Hall element's place and record step and reading on one clock.",
        ),
    ),
)
