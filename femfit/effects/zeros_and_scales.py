"""A zero or a scale is wrong: of the stage, the ammeter, the force sensor, the Hall element, the driver, the balance.

``distance_offset``, ``distance_scale``
    Stages are zeroed where the parts touch, so a wrong scale acts about the distance 0, not about the middle of the
    table.

``driver_gain``
    A bench reads the voltage across the winding and does not see the driver's scale.

``position_delay``, ``position_nonlinearity``
    The position sensor of a record is late or bent; zero and gain are ``distance_offset`` and ``distance_scale``. Late
    by tau, the body is already at d + tau v. Bent, the true distance departs from the recorded one by a bow, zero at
    both ends of the travel and largest between them, and by an S, zero in the middle as well.
"""

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.effects.effect import Calibration, Effect, EffectPoint, effect_of, in_channel, parameter_of

DISTANCE_OFFSET = effect_of(
    name="distance_offset",
    symptom="Every channel looks as if measured at another distance, the same amount everywhere.",
    parameter="offset_m",
    limits=(-5e-3, -1e-3, 1e-3, 5e-3),
    description="True minus recorded distance.",
    words="the gap is {size} {larger|smaller} than recorded",
    needs=("distance_m", "force_N|flux_linkage_Wb|inductance_H|hall_V"),
    experiment="Rest the moving part on a thin gauge block of known height and compare the stage's reading.",
    reference="First-order error of a stage's zero; JCGM 100:2008 (GUM), section 3.2.4",
    setting=lambda point: (point.d + point.p["offset_m"], point.i),
    read=(1e-5, 10.0),
    also={"distance_scale": {"scale_error": 1e-3}},  # a block of 1 mm
)


DISTANCE_SCALE = effect_of(
    name="distance_scale",
    symptom="Every channel looks as if measured at another distance, the more so the further away.",
    parameter="scale_error",
    limits=(-0.3, -0.05, 0.05, 0.3),
    description="True over recorded distance, less one.",
    words="distances are {size} {larger|smaller} than recorded",
    needs=("~distance_m", "force_N|flux_linkage_Wb|inductance_H|hall_V"),
    experiment="Read the stage over two gauge blocks, the shortest and the longest that fit.",
    reference="Linear error of a stage; ISO 230-2 (2014)",
    setting=lambda point: ((1.0 + point.p["scale_error"]) * point.d, point.i),
    read=(1e-3, 20.0),
)


CURRENT_OFFSET = effect_of(
    name="current_offset",
    symptom="Every channel looks as if a constant current were added to the recorded one.",
    parameter="offset",
    limits=(-1.0, -0.05, 0.05, 1.0),
    description="True minus recorded current, as a part of the largest current.",
    words="the true current is {size} {larger|smaller} than the ammeter's reading",
    scale="peak_current_A",
    needs=("current_A", "force_N|flux_linkage_Wb|inductance_H|hall_V|voltage_V"),
    experiment="Open the circuit and read the ammeter at zero current.",
    reference="JCGM 100:2008 (GUM), section 3.2.4",
    setting=lambda point: (point.d, point.i + point.p["offset"] * point.nominal.peak_current_A),
    read=(1e-3, 5.0),
)


CURRENT_GAIN = effect_of(
    name="current_gain",
    symptom="Every channel looks as if the current were another, by the same percentage.",
    parameter="gain_error",
    limits=(-0.9, -0.1, 0.1, 2.0),
    description="True over recorded current, less one.",
    words="the true current is {size} {larger|smaller} than the ammeter's reading",
    needs=("~current_A", "force_N|flux_linkage_Wb|inductance_H|hall_V|voltage_V"),
    experiment="Read the current with a calibrated shunt in series.",
    reference="JCGM 100:2008 (GUM), section 4.3",
    setting=lambda point: (point.d, (1.0 + point.p["gain_error"]) * point.i),
    read=(1e-3, 20.0),
)


FORCE_OFFSET = effect_of(
    name="force_offset",
    symptom="Every force is wrong by the same amount, also far away and without current.",
    parameter="offset",
    limits=(-1.0, -0.05, 0.05, 1.0),
    description="Recorded minus true force, as a part of the largest force.",
    words="the force sensor reads {size} too {much|little}",
    scale="force_N",
    needs=("force_N",),
    experiment="Take everything off the force sensor, and read it.",
    reference="JCGM 100:2008 (GUM), section 3.2.4; OIML R 60 (2000): a cell comes back to its zero to 1 part in 6000",
    readings=in_channel("force_N", lambda force, point: force + point.p["offset"] * point.nominal.force_N),
    read=(2e-4, 10.0),
)


FORCE_GAIN = effect_of(
    name="force_gain",
    symptom="Every force is wrong by the same percentage; flux linkage and Hall voltage are right.",
    parameter="gain_error",
    limits=(-0.9, -0.1, 0.1, 2.0),
    description="Recorded over true force, less one.",
    words="the force sensor reads {size} too {much|little}",
    needs=("force_N",),
    experiment="Hang a reference weight on the force sensor and compare its reading.",
    reference="JCGM 100:2008 (GUM), section 4.3; OIML R 111-1 (2004) for the weight",
    readings=in_channel("force_N", lambda force, point: (1.0 + point.p["gain_error"]) * force),
    read=(1e-3, 20.0),
)


HALL_OFFSET = effect_of(
    name="hall_offset",
    symptom="The Hall voltage is wrong by the same amount everywhere; force and flux linkage are right.",
    parameter="offset_V",
    limits=(-1.0, -0.1, 0.1, 1.0),
    description="Recorded minus expected voltage.",
    words="the Hall voltage is {size} too {high|low}",
    needs=("hall_V",),
    experiment="Put the Hall element into a zero-gauss chamber and read its voltage.",
    reference="E. Ramsden, Hall-Effect Sensors (Newnes, 2006), chapter 2",
    readings=in_channel("hall_V", lambda volts, point: volts + point.p["offset_V"]),
    read=(1e-3, 15.0),
)


MASS_ERROR = effect_of(
    name="mass_error",
    symptom="The body hangs at another current and accelerates otherwise than the model's; bench readings are right.",
    parameter="mass_error",
    limits=(-0.9, -0.3, 0.3, 9.0),
    description="True over the model's mass, less one.",
    words="the moving mass is {size} {larger|smaller} than in the model",
    needs=("time_s", "distance_m|hall_V"),
    experiment="Weigh the moving part with everything that moves with it.",
    reference="Newton's second law; H. Goldstein, Classical Mechanics (Addison-Wesley, 1980), section 1.1",
    mass=lambda mass, p: (1.0 + p["mass_error"]) * mass,
    read=(1e-3, 5.0),
)


DRIVER_GAIN = effect_of(
    name="driver_gain",
    symptom="The current goes to another value than the commanded voltage asks for, by the same percentage.",
    parameter="gain_error",
    limits=(-0.9, -0.1, 0.1, 2.0),
    description="Applied over commanded voltage, less one.",
    words="the driver gives {size} {more|less} voltage than commanded",
    needs=("time_s", "voltage_V", "current_A", "voltage driver"),
    experiment="Command a few constant voltages and read the voltage across the winding.",
    reference="JCGM 100:2008 (GUM), section 4.3",
    circuit=lambda resistance, voltage, point: (resistance, (1.0 + point.p["gain_error"]) * voltage),
    read=(1e-3, 10.0),
)


POSITION_DELAY = effect_of(
    name="position_delay",
    symptom="The recorded distance follows the body late; at rest it is right.",
    parameter="delay_s",
    limits=(0.0, 0.0, 5e-3, 0.05),
    description="Age of what a recorded distance shows.",
    words="the recorded distance is {size} late",
    needs=("time_s", "~distance_m"),
    experiment="Drop the body on its stop, and record its sensor and a microphone on one clock.",
    reference="Astrom and Wittenmark, Computer-Controlled Systems (1997), section 2.3 (delays)",
    setting=lambda point: (point.d + point.p["delay_s"] * point.velocity, point.i),
    read=(5e-5, 40.0),
)


def _straightened(point: EffectPoint) -> tuple[FloatArray, FloatArray]:
    nominal = point.nominal
    u = np.clip((point.d - nominal.distance_min_m) / nominal.travel_m, 0.0, 1.0)
    bow, bend = 4.0 * u * (1.0 - u), 12.0 * np.sqrt(3.0) * u * (1.0 - u) * (0.5 - u)
    return point.d + nominal.travel_m * (point.p["bow"] * bow + point.p["bend"] * bend), point.i


POSITION_NONLINEARITY = Effect(
    name="position_nonlinearity",
    symptom="The recorded distance is right at both ends of the travel and wrong between them.",
    parameters=(
        parameter_of(
            "bow",
            limits=(-0.2, -0.03, 0.03, 0.2),
            description="True minus recorded distance in the middle of the range, as a part of its width.",
            words="the body is {size} {further away|nearer} than recorded in the middle of the travel",
            scale="travel_m",
        ),
        parameter_of(
            "bend",
            limits=(-0.1, -0.03, 0.03, 0.1),
            description="The same at about a fifth of the range, with the other sign at four fifths.",
            words="the body is {size} {further away|nearer} than recorded at a fifth of the travel, and the other way "
            "round at four fifths",
            scale="travel_m",
        ),
    ),
    needs=("time_s", "~distance_m"),
    experiment="Read the position sensor over five gauge blocks, from the shortest to the longest that fit.",
    reference="IEC 60770-1 (2010), conformity error; Nyce, Linear Position Sensors (Wiley, 2004), chapter 1",
    setting=_straightened,
    calibrations=(Calibration({"bow": 1e-3, "bend": 1e-3}, 40.0),),
)
