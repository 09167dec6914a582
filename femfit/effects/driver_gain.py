"""The driver gives more or less voltage than it is told: applied voltage = (1 + gain error) commanded voltage.

A bench reads across the winding and does not see it.
"""

from femfit.effects.effect import Calibration, Effect, EffectParameter

_READ = "Command a few constant voltages and read the voltage across the winding."

DRIVER_GAIN = Effect(
    name="driver_gain",
    symptom="The current goes to another value than the commanded voltage asks for, by the same percentage.",
    acts_on=("circuit",),
    parameters=(
        EffectParameter(
            "gain_error",
            "",
            bounds=(-0.9, 2.0),
            plausible=(-0.1, 0.1),
            description="Applied over commanded voltage, less one.",
            words="the driver gives {size} {more|less} voltage than commanded",
        ),
    ),
    needs=("time_s", "voltage_V", "current_A"),
    experiment=_READ,
    reference="JCGM 100:2008 (GUM), section 4.3",
    circuit=lambda resistance, voltage, i, conditions, p: (resistance, (1.0 + p["gain_error"]) * voltage),
    calibrations=(Calibration({"gain_error": 1e-3}, 10.0, _READ),),
)
