"""The position sensor of a record is late or bent; zero and gain are ``distance_offset`` and ``distance_scale``.

Late by tau, the body is already at d + tau v. Bent, the true distance departs from the recorded one by a bow, zero at
both ends of the travel and largest between them, and by an S, zero in the middle as well.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters

POSITION_DELAY = Effect(
    name="position_delay",
    symptom="The recorded distance follows the body late; at rest it is right.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            "delay_s",
            unit="s",
            bounds=(0.0, 0.05),
            plausible=(0.0, 5e-3),
            description="Age of what a recorded distance shows.",
            words="the recorded distance is {size} late",
        ),
    ),
    needs=("time_s", "~distance_m"),
    experiment="Move the body quickly by hand, and record its sensor beside a second, faster one on one clock.",
    reference="Astrom and Wittenmark, Computer-Controlled Systems (1997), section 2.3 (delays)",
    setting=lambda d, i, conditions, p: (d + p["delay_s"] * like(conditions.velocity_m_s, d), i),
    calibrations=(
        Calibration(
            {"delay_s": 5e-5}, 40.0, "Drop the body on its stop, and record its sensor and a microphone on one clock."
        ),
    ),
)


def _straightened(d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters) -> tuple[FloatArray, FloatArray]:
    nominal = conditions.nominal
    u = np.clip((d - nominal.distance_min_m) / nominal.travel_m, 0.0, 1.0)
    bow, bend = 4.0 * u * (1.0 - u), 12.0 * np.sqrt(3.0) * u * (1.0 - u) * (0.5 - u)
    return d + nominal.travel_m * (p["bow"] * bow + p["bend"] * bend), i


_GAUGE_BLOCKS = "Read the position sensor over five gauge blocks, from the shortest to the longest that fit."

POSITION_NONLINEARITY = Effect(
    name="position_nonlinearity",
    symptom="The recorded distance is right at both ends of the travel and wrong between them.",
    acts_on=("bench",),
    parameters=(
        EffectParameter(
            "bow",
            bounds=(-0.2, 0.2),
            plausible=(-0.03, 0.03),
            description="True minus recorded distance in the middle of the range, as a part of its width.",
            words="the body is {size} {further away|nearer} than recorded in the middle of the travel",
            scale="travel_m",
        ),
        EffectParameter(
            "bend",
            bounds=(-0.1, 0.1),
            plausible=(-0.03, 0.03),
            description="The same at about a fifth of the range, with the other sign at four fifths.",
            words="the body is {size} {further away|nearer} than recorded at a fifth of the travel, and the other way "
            "round at four fifths",
            scale="travel_m",
        ),
    ),
    needs=("time_s", "~distance_m"),
    experiment=_GAUGE_BLOCKS,
    reference="IEC 60770-1 (2010), conformity error; Nyce, Linear Position Sensors (Wiley, 2004), chapter 1",
    setting=_straightened,
    calibrations=(Calibration({"bow": 1e-3, "bend": 1e-3}, 40.0, _GAUGE_BLOCKS),),
)
