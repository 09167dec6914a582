"""The driver gives more or less voltage than it is told."""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters


def _circuit(
    resistance: FloatArray, voltage: FloatArray, current: FloatArray, conditions: Conditions, p: Parameters
) -> tuple[FloatArray, FloatArray]:
    return resistance, (1.0 + p["gain_error"]) * voltage


DRIVER_GAIN = Effect(
    name="driver_gain",
    symptom="The current goes to another value than the commanded voltage asks for, by the same percentage.",
    acts_on=("circuit",),
    parameters=(
        EffectParameter(
            name="gain_error",
            unit="",
            lower=-0.9,
            upper=2.0,
            plausible=(-0.1, 0.1),
            description="Applied over commanded voltage, less one.",
        ),
    ),
    needs=("time_s", "voltage_V", "current_A"),
    experiment="Command a few constant voltages and read the voltage across the winding.",
    reference="JCGM 100:2008 (GUM), section 4.3",
    circuit=_circuit,
    calibrations=(
        Calibration(
            {"gain_error": 1e-3},
            10.0,
            "Command a few constant voltages and read the voltage across the winding.",
        ),
    ),
)
"""Applied voltage = (1 + gain error) commanded voltage. A bench reads across the winding and does not see it."""
