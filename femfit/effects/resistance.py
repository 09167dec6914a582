"""The winding's resistance is not the drawing's, at every current and temperature: R -> (1 + resistance error) R."""

from femfit.effects.effect import Calibration, Effect, EffectParameter

_FOUR_WIRES = "Measure the cold winding's resistance with four wires, at the terminals that the driver feeds."

RESISTANCE = Effect(
    name="resistance",
    symptom="The voltage across the winding is larger or smaller than drawn at every current and temperature.",
    acts_on=("circuit",),
    parameters=(
        EffectParameter(
            "resistance_error",
            "",
            bounds=(-0.9, 9.0),
            plausible=(-0.2, 0.5),
            description="True over drawn resistance at 20 °C, leads included, less one.",
            words="the winding's resistance is {size} {larger|smaller} than drawn",
        ),
    ),
    needs=("~current_A", "voltage_V"),
    experiment=_FOUR_WIRES,
    reference="IEC 60317-0-1 (2013), resistance of round wire",
    circuit=lambda resistance, voltage, i, conditions, p: (resistance * (1.0 + p["resistance_error"]), voltage),
    calibrations=(Calibration({"resistance_error": 2e-3}, 10.0, _FOUR_WIRES, {"turns": {"turns_error": 1.0}}),),
)
