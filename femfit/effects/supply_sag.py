"""Supply and driver have an inner resistance: applied voltage = commanded voltage - R_s i.

A bench reads across the winding and does not see it; a record of commanded voltages sees the sum of both resistances.
"""

from femfit.effects.effect import Calibration, Effect, EffectParameter

_READ = (
    "Command a constant voltage and read that across the winding, with the body held, at a small and a large current."
)

SUPPLY_SAG = Effect(
    name="supply_sag",
    symptom="The current falls short of the commanded voltage the more, the larger it is; at rest as after a step.",
    acts_on=("circuit",),
    parameters=(
        EffectParameter(
            "inner_resistance",
            bounds=(0.0, 10.0),
            plausible=(0.0, 0.3),
            description="Inner resistance of supply, driver and leads before the terminals, over the winding's.",
            words="supply and driver have an inner resistance of {size} of the winding's",
        ),
    ),
    needs=("time_s", "voltage_V", "~current_A", "voltage driver"),
    experiment=_READ,
    reference="Horowitz and Hill, The Art of Electronics (2015), section 1.2 (Thevenin's equivalent of a source)",
    circuit=lambda resistance, voltage, i, conditions, p: (
        resistance,
        voltage - p["inner_resistance"] * conditions.nominal.resistance_ohm * i,
    ),
    calibrations=(Calibration({"inner_resistance": 5e-3}, 10.0, _READ),),
)
