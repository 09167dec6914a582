"""What changes a Hall element's output: temperature, time, a large field, and the coil's leads.

``hall_temperature``
    Offset and sensitivity grow linearly with its temperature, which is rarely recorded: it lies between that of the
    coil, on whose face the element sits, and that of the magnet's surroundings.

``hall_drift``
    A ramp, or a warm-up that settles, over the campaign or anew each run.

``hall_saturation``
    In large fields the output falls behind, by a cubic onset or a limit with a knee.

``hall_coil_pickup``
    The coil's leads and their supply disturb the reading: in step with the current, and with its rate.
"""

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.effects.conditions import like, warmth
from femfit.effects.effect import Calibration, Effect, EffectPoint, current_lag, in_channel, parameter_of


def _warmed(volts: FloatArray, point: EffectPoint) -> FloatArray:
    conditions, p = point.conditions, point.p
    coil, magnet = warmth(conditions.coil_temperature_C).kelvin, warmth(conditions.magnet_temperature_C).kelvin
    warmer = p["coil_share"] * coil + (1.0 - p["coil_share"]) * magnet
    return volts + warmer * (p["offset_V_per_K"] + p["sensitivity_per_K"] * (volts - point.nominal.hall_quiescent_V))


HALL_TEMPERATURE = Effect(
    name="hall_temperature",
    symptom="The Hall voltage goes with the temperature; force and flux linkage do not.",
    parameters=(
        parameter_of(
            "offset_V_per_K",
            limits=(-0.1, -5e-3, 5e-3, 0.1),
            description="Change of the quiescent voltage per kelvin.",
            words="the Hall voltage at no field changes by {signed}",
        ),
        parameter_of(
            "sensitivity_per_K",
            limits=(-0.02, -3e-3, 3e-3, 0.02),
            description="Relative change of the sensitivity per kelvin.",
            words="the Hall element's sensitivity changes by {signed}",
        ),
        parameter_of(
            "coil_share",
            limits=(0.0, 0.0, 1.0, 1.0),
            description="How far the element's temperature follows the coil's instead of the magnet's.",
            words="its temperature follows the winding's by {size}",
            usual=1.0,
        ),
    ),
    needs=("hall_V", "~coil_temperature_C|~magnet_temperature_C"),
    experiment="Warm the Hall element by 30 K, in a zero-gauss chamber and then over a fixed magnet, and read its "
    "voltage.",
    reference="Popovic, Hall Effect Devices (2004), sections 4.8 and 5.6; Allegro A1321 data sheet",
    readings=in_channel("hall_V", _warmed),
    calibrations=(Calibration({"offset_V_per_K": 5e-5, "sensitivity_per_K": 5e-5}, 60.0),),
)


_UNIT_OF_TIME = 1000.0
"""Ramps count in thousands of readings, or of seconds where the data have a clock."""


def _drifted(volts: FloatArray, point: EffectPoint) -> FloatArray:
    elapsed, run_time = like(point.conditions.elapsed, volts), like(point.conditions.time_s, volts)
    ramps = (point.p["ramp_V"] * elapsed + point.p["run_ramp_V"] * run_time) / _UNIT_OF_TIME
    settled = [-np.expm1(-time / point.p["settling_time"]) for time in (elapsed, run_time)]
    return volts + ramps + point.p["settling_V"] * settled[0] + point.p["run_settling_V"] * settled[1]


HALL_DRIFT = Effect(
    name="hall_drift",
    symptom="The Hall voltage wanders with time, whatever the distance and current.",
    parameters=(
        parameter_of(
            "ramp_V",
            limits=(-20.0, -0.2, 0.2, 20.0),
            description="Drift over 1000 readings (or seconds) of the campaign.",
            words="the Hall voltage drifts by {signed} in 1000 readings or seconds of the campaign",
        ),
        parameter_of(
            "run_ramp_V",
            limits=(-20.0, -0.2, 0.2, 20.0),
            description="Drift over 1000 readings (or seconds) of a run, zero at its start.",
            words="the Hall voltage drifts by {signed} in 1000 readings or seconds of each run",
        ),
        parameter_of(
            "settling_V",
            limits=(-10.0, -0.1, 0.1, 10.0),
            description="Final drift of a warm-up that begins with the campaign.",
            words="the Hall voltage settles by {signed} from the start of the campaign",
        ),
        parameter_of(
            "run_settling_V",
            limits=(-10.0, -0.1, 0.1, 10.0),
            description="Final drift of a warm-up that begins with each run.",
            words="the Hall voltage settles by {signed} from the start of each run",
        ),
        parameter_of(
            "settling_time",
            unit="readings or s",
            limits=(1.0, 20.0, 500.0, 1e4),
            description="Time constant of a warm-up, in readings where the data have no clock.",
            usual=100.0,
        ),
    ),
    needs=("hall_V", "~elapsed"),
    experiment="Read the Hall voltage at one distance and current, switched on anew, for as long as the campaign took.",
    reference="Popovic, Hall Effect Devices (2004), section 5.6 (offset drift)",
    readings=in_channel("hall_V", _drifted),
    calibrations=(Calibration({"ramp_V": 5e-3, "run_ramp_V": 5e-3, "settling_V": 2e-3, "run_settling_V": 2e-3}, 60.0),),
)


_ROUNDING = 0.03
"""Half width of the knee's corner over the largest swing: amplifiers do not clip at once."""


def _beyond(excess: FloatArray) -> FloatArray:
    """max(0, excess) with a rounded corner."""
    return 0.5 * (excess + np.sqrt(excess**2 + _ROUNDING**2))


def _limited(volts: FloatArray, point: EffectPoint) -> FloatArray:
    swing, knee = point.nominal.hall_swing_V, point.p["knee"]
    x = (volts - point.nominal.hall_quiescent_V) / swing
    # Odd in x and zero at zero
    limited = _beyond(x - knee) - _beyond(-x - knee)
    return volts - swing * (point.p["cubic_loss"] * x**3 + point.p["limited_loss"] * limited)


HALL_SATURATION = Effect(
    name="hall_saturation",
    symptom="The Hall voltage falls behind the model where it is far from its quiescent value.",
    parameters=(
        parameter_of(
            "cubic_loss",
            limits=(-0.05, 0.0, 0.2, 0.33),
            description="Lost part of the largest swing, growing with the cube of the field.",
            words="the Hall voltage {loses|gains} {size} at its largest swing",
        ),
        parameter_of(
            "limited_loss",
            limits=(0.0, 0.0, 1.0, 1.0),
            description="Lost part of the sensitivity beyond the knee; 1 is a hard limit.",
            words="the Hall element loses {size} of its sensitivity beyond a knee",
        ),
        parameter_of(
            "knee",
            limits=(0.1, 0.4, 1.0, 1.2),
            description="Where the limit begins, as a part of the model's largest swing.",
            usual=0.8,
        ),
    ),
    needs=("hall_V",),
    experiment="Go as near as possible at the largest current of each sign, and compare the Hall voltage with that of "
    "a second element of a lower sensitivity.",
    reference="Popovic, Hall Effect Devices (2004), section 4.5 (nonlinearity)",
    readings=in_channel("hall_V", _limited),
)


def _picked_up(volts: FloatArray, point: EffectPoint) -> FloatArray:
    nominal = point.nominal
    if "pickup_lag" in point.conditions.memory:
        rate = point.conditions.memory["pickup_lag"] / nominal.sample_time_s
    else:
        rate = like(point.conditions.current_rate_A_s, point.i) / nominal.peak_current_A
    return volts + point.p["pickup_V"] * point.i / nominal.peak_current_A + point.p["induced_V_s"] * rate


HALL_COIL_PICKUP = Effect(
    name="hall_coil_pickup",
    symptom="The Hall voltage has a further part in step with the current; force and flux linkage are right.",
    parameters=(
        parameter_of(
            "pickup_V",
            limits=(-5.0, -0.3, 0.3, 5.0),
            description="Further voltage at the largest current.",
            words="the Hall voltage changes by {signed} at the largest current",
        ),
        parameter_of(
            "induced_V_s",
            unit="V s",
            limits=(-0.1, -1e-3, 1e-3, 0.1),
            description="Further voltage while the current changes by its largest value in a second.",
            words="the leads induce {signed} in the Hall reading when the largest current is switched",
        ),
    ),
    needs=("~current_A", "hall_V"),
    experiment="Put the Hall element with its leads into a zero-gauss chamber and read it at the largest current of "
    "each sign.",
    reference="Ott, Electromagnetic Compatibility Engineering (2009), chapters 2 (coupling) and 3 (common ground)",
    readings=in_channel("hall_V", _picked_up),
    memory=current_lag("pickup_lag", "induced_V_s", 0.01, lambda nominal, p: nominal.sample_time_s),
    calibrations=(Calibration({"pickup_V": 2e-3}, 20.0),),
)
