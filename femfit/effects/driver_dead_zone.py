"""The driver loses a constant voltage: below a threshold it gives nothing, or its switches' drop opposes the current.

Applied voltage = commanded voltage less a dead zone, less a drop against the current.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters

_ROUNDING = 1e-2
"""Current, over the largest, within which the drop turns its sign."""


def _circuit(
    resistance: FloatArray, voltage: FloatArray, current: FloatArray, conditions: Conditions, p: Parameters
) -> tuple[FloatArray, FloatArray]:
    nominal = conditions.nominal
    zone, drop = p["dead_zone"] * nominal.voltage_V, p["drop"] * nominal.voltage_V
    applied = voltage - np.clip(voltage, -zone, zone)
    return resistance, applied - drop * np.tanh(current / (_ROUNDING * nominal.peak_current_A))


DRIVER_DEAD_ZONE = Effect(
    name="driver_dead_zone",
    symptom="The current is too small by the same amount at any commanded voltage, and none at a small one.",
    acts_on=("circuit",),
    parameters=(
        EffectParameter(
            "dead_zone",
            bounds=(0.0, 1.0),
            plausible=(0.0, 0.2),
            description="Commanded voltage up to which nothing comes, as a part of the largest.",
            words="the driver gives nothing up to {size}",
            scale="voltage_V",
        ),
        EffectParameter(
            "drop",
            bounds=(0.0, 1.0),
            plausible=(0.0, 0.3),
            description="Voltage lost in the switches against the current, as a part of the largest.",
            words="the driver's switches lose {size}",
            scale="voltage_V",
        ),
    ),
    needs=("time_s", "voltage_V", "current_A", "voltage driver"),
    experiment="Raise the commanded voltage slowly from zero, in both directions, and read the current.",
    reference="Mohan, Undeland and Robbins, Power Electronics (2003), section 8.5 (blanking time)",
    circuit=_circuit,
    calibrations=(
        Calibration(
            {"dead_zone": 2e-3, "drop": 2e-3},
            30.0,
            "Raise the commanded voltage slowly from zero, in both directions, and read the voltage across the "
            "winding.",
        ),
    ),
)
