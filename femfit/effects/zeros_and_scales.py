"""A zero or a scale is wrong: of the stage, the ammeter, the force sensor, the Hall element, the driver, the balance.

Stages are zeroed where the parts touch, so a wrong scale acts about the distance 0, not about the middle of the table.
A bench reads the voltage across the winding and does not see the driver's scale.
"""

from femfit.effects.effect import Calibration, Effect, EffectParameter, in_channel

DISTANCE_OFFSET = Effect(
    name="distance_offset",
    symptom="Every channel looks as if measured at another distance, the same amount everywhere.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            "offset_m",
            unit="m",
            bounds=(-5e-3, 5e-3),
            plausible=(-1e-3, 1e-3),
            description="True minus recorded distance.",
            words="the gap is {size} {larger|smaller} than recorded",
        ),
    ),
    needs=("distance_m", "force_N|flux_linkage_Wb|inductance_H|hall_V"),
    experiment="Touch the face with a gauge block of known height and read the stage; or measure where the force "
    "gradient is largest, at two currents.",
    reference="First-order error of a stage's zero; JCGM 100:2008 (GUM), section 3.2.4",
    setting=lambda d, i, conditions, p: (d + p["offset_m"], i),
    calibrations=(
        Calibration(
            {"offset_m": 1e-5},
            10.0,
            "Rest the moving part on a thin gauge block of known height and compare the stage's reading.",
            also={"distance_scale": {"scale_error": 1e-3}},  # a block of 1 mm
        ),
    ),
)


_GAUGE_BLOCKS = "Read the stage over two gauge blocks, the shortest and the longest that fit."

DISTANCE_SCALE = Effect(
    name="distance_scale",
    symptom="Every channel looks as if measured at another distance, the more so the further away.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            "scale_error",
            bounds=(-0.3, 0.3),
            plausible=(-0.05, 0.05),
            description="True over recorded distance, less one.",
            words="distances are {size} {larger|smaller} than recorded",
        ),
    ),
    needs=("~distance_m", "force_N|flux_linkage_Wb|inductance_H|hall_V"),
    experiment=_GAUGE_BLOCKS,
    reference="Linear error of a stage; ISO 230-2 (2014)",
    setting=lambda d, i, conditions, p: ((1.0 + p["scale_error"]) * d, i),
    calibrations=(Calibration({"scale_error": 1e-3}, 20.0, _GAUGE_BLOCKS),),
)


CURRENT_OFFSET = Effect(
    name="current_offset",
    symptom="Every channel looks as if a constant current were added to the recorded one.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            "offset",
            bounds=(-1.0, 1.0),
            plausible=(-0.05, 0.05),
            description="True minus recorded current, as a part of the largest current.",
            words="the true current is {size} {larger|smaller} than the ammeter's reading",
            scale="peak_current_A",
        ),
    ),
    needs=("current_A", "force_N|flux_linkage_Wb|inductance_H|hall_V|voltage_V"),
    experiment="Open the circuit and read the ammeter; or measure at both signs of the current.",
    reference="JCGM 100:2008 (GUM), section 3.2.4",
    setting=lambda d, i, conditions, p: (d, i + p["offset"] * conditions.nominal.peak_current_A),
    calibrations=(Calibration({"offset": 1e-3}, 5.0, "Open the circuit and read the ammeter at zero current."),),
)


CURRENT_GAIN = Effect(
    name="current_gain",
    symptom="Every channel looks as if the current were another, by the same percentage.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            "gain_error",
            bounds=(-0.9, 2.0),
            plausible=(-0.1, 0.1),
            description="True over recorded current, less one.",
            words="the true current is {size} {larger|smaller} than the ammeter's reading",
        ),
    ),
    needs=("~current_A", "force_N|flux_linkage_Wb|inductance_H|hall_V|voltage_V"),
    experiment="Read the current with a calibrated shunt in series.",
    reference="JCGM 100:2008 (GUM), section 4.3",
    setting=lambda d, i, conditions, p: (d, (1.0 + p["gain_error"]) * i),
    calibrations=(
        Calibration({"gain_error": 1e-3}, 20.0, "Put a calibrated shunt in series and compare the ammeter's reading."),
    ),
)


_UNLOADED = "Take everything off the force sensor, and read it."

FORCE_OFFSET = Effect(
    name="force_offset",
    symptom="Every force is wrong by the same amount, also far away and without current.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "offset",
            bounds=(-1.0, 1.0),
            plausible=(-0.05, 0.05),
            description="Recorded minus true force, as a part of the largest force.",
            words="the force sensor reads {size} too {much|little}",
            scale="force_N",
        ),
    ),
    needs=("force_N",),
    experiment=_UNLOADED,
    reference="JCGM 100:2008 (GUM), section 3.2.4",
    readings=in_channel("force_N", lambda force, conditions, p: force + p["offset"] * conditions.nominal.force_N),
    calibrations=(Calibration({"offset": 1e-3}, 10.0, _UNLOADED),),
)


_WEIGHT = "Hang a reference weight on the force sensor and compare its reading."

FORCE_GAIN = Effect(
    name="force_gain",
    symptom="Every force is wrong by the same percentage; flux linkage and Hall voltage are right.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "gain_error",
            bounds=(-0.9, 2.0),
            plausible=(-0.1, 0.1),
            description="Recorded over true force, less one.",
            words="the force sensor reads {size} too {much|little}",
        ),
    ),
    needs=("force_N",),
    experiment=_WEIGHT,
    reference="JCGM 100:2008 (GUM), section 4.3; OIML R 111-1 (2004) for the weight",
    readings=in_channel("force_N", lambda force, conditions, p: (1.0 + p["gain_error"]) * force),
    calibrations=(Calibration({"gain_error": 1e-3}, 20.0, _WEIGHT),),
)


HALL_OFFSET = Effect(
    name="hall_offset",
    symptom="The Hall voltage is wrong by the same amount everywhere; force and flux linkage are right.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "offset_V",
            unit="V",
            bounds=(-1.0, 1.0),
            plausible=(-0.1, 0.1),
            description="Recorded minus expected voltage.",
            words="the Hall voltage is {size} too {high|low}",
        ),
    ),
    needs=("hall_V",),
    experiment="Remove the moving part, switch the current off and read the Hall voltage.",
    reference="E. Ramsden, Hall-Effect Sensors (Newnes, 2006), chapter 2",
    readings=in_channel("hall_V", lambda volts, conditions, p: volts + p["offset_V"]),
    calibrations=(
        Calibration({"offset_V": 1e-3}, 15.0, "Put the Hall element into a zero-gauss chamber and read its voltage."),
    ),
)


MASS_ERROR = Effect(
    name="mass_error",
    symptom="The body hangs at another current and accelerates otherwise than the model's; bench readings are right.",
    acts_on=("motion",),
    parameters=(
        EffectParameter(
            "mass_error",
            bounds=(-0.9, 9.0),
            plausible=(-0.3, 0.3),
            description="True over the model's mass, less one.",
            words="the moving mass is {size} {larger|smaller} than in the model",
        ),
    ),
    needs=("time_s", "distance_m|hall_V"),
    experiment="Weigh the moving part with everything that moves with it.",
    reference="Newton's second law; H. Goldstein, Classical Mechanics (Addison-Wesley, 1980), section 1.1",
    mass=lambda mass, p: (1.0 + p["mass_error"]) * mass,
    calibrations=(Calibration({"mass_error": 1e-3}, 5.0, "Weigh the moving part on a balance."),),
)


_READ = "Command a few constant voltages and read the voltage across the winding."

DRIVER_GAIN = Effect(
    name="driver_gain",
    symptom="The current goes to another value than the commanded voltage asks for, by the same percentage.",
    acts_on=("circuit",),
    parameters=(
        EffectParameter(
            "gain_error",
            bounds=(-0.9, 2.0),
            plausible=(-0.1, 0.1),
            description="Applied over commanded voltage, less one.",
            words="the driver gives {size} {more|less} voltage than commanded",
        ),
    ),
    needs=("time_s", "voltage_V", "current_A", "voltage driver"),
    experiment=_READ,
    reference="JCGM 100:2008 (GUM), section 4.3",
    circuit=lambda resistance, voltage, i, conditions, p: (resistance, (1.0 + p["gain_error"]) * voltage),
    calibrations=(Calibration({"gain_error": 1e-3}, 10.0, _READ),),
)
