"""The winding's resistance grows with its temperature: R -> (1 + coefficient (T - 20 °C)) R."""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.constants import COPPER_TEMPERATURE_COEFFICIENT
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C, Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters


def _circuit(
    resistance: FloatArray, voltage: FloatArray, current: FloatArray, conditions: Conditions, p: Parameters
) -> tuple[FloatArray, FloatArray]:
    recorded = like(conditions.coil_temperature_C, current) - REFERENCE_TEMPERATURE_C
    warming = 1.0 if conditions.running else -np.expm1(-like(conditions.time_s, current) / p["warming_time"])
    unrecorded = COPPER_TEMPERATURE_COEFFICIENT * (p["warmer_K"] + p["warming_K"] * warming)
    growth = p["coefficient_per_K"] * np.nan_to_num(recorded) + np.where(
        np.isnan(recorded) | conditions.running, unrecorded, 0.0
    )
    return resistance * (1.0 + growth), voltage


COIL_TEMPERATURE = Effect(
    name="coil_temperature",
    symptom="The voltage at a given current grows as the coil gets warm; force, flux linkage and Hall voltage do not.",
    acts_on=("circuit",),
    parameters=(
        EffectParameter(
            "coefficient_per_K",
            unit="1/K",
            bounds=(-0.01, 0.02),
            plausible=(2e-3, 6e-3),
            description="Relative change of the resistance per kelvin of the recorded temperature over 20 °C.",
            words="the resistance {grows|falls} by {size} of the recorded temperature",
        ),
        EffectParameter(
            "warmer_K",
            unit="K",
            bounds=(-60.0, 250.0),
            plausible=(-10.0, 100.0),
            description="Where its temperature was not recorded: the coil's over 20 °C, by 0.393 % a kelvin.",
            words="the winding is {size} {warmer|colder} than 20 °C",
        ),
        EffectParameter(
            "warming_K",
            unit="K",
            bounds=(-60.0, 250.0),
            plausible=(-10.0, 100.0),
            description="Where its temperature was not recorded: final warming since the start of the run.",
            words="the winding {warms|cools} by {size} in a run",
        ),
        EffectParameter(
            "warming_time",
            unit="readings or s",
            bounds=(1.0, 1e4),
            plausible=(20.0, 500.0),
            description="Time constant of the warming, in readings where the data have no clock.",
            null=100.0,
            nonlinear=True,
        ),
    ),
    needs=("~current_A|resistance_ohm", "voltage_V|resistance_ohm"),
    experiment="Read voltage and current of the coil cold, and again after ten minutes at its largest current.",
    reference="IEC 60028 (1925): copper, 0.00393 per kelvin at 20 °C",
    circuit=_circuit,
    calibrations=(
        Calibration(
            {"coefficient_per_K": 1e-4},
            40.0,
            "Measure the winding's resistance by four wires, cold and warm, with a thermometer on the winding.",
        ),
        Calibration(
            {"warmer_K": 1.0, "warming_K": 2.0},
            15.0,
            "Put a thermometer on the winding and read it at the start and at the end of a run.",
        ),
    ),
)
