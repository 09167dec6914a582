"""The spring of the drawing is another one, or the force sensor carries it.

Stiffer by a part e, as of thicker wire, a spring has no force at the same free length and 1 + e times the drawn force
anywhere else: its further energy is e U(d), also of several springs and of a force table. Another preload is a further
constant. A model's force is the magnetic one; a load cell between spring and frame reads that, one that holds the body
reads the spring as well.
"""

from collections.abc import Mapping

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters
from femfit.effects.spring import spring_coenergy
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries, distance_series

_BALANCE = "Take the spring out and read its force at two lengths with a spring balance."
_REFERENCE = "Budynas and Nisbett, Shigley's Mechanical Engineering Design (2015), chapter 10"


def _stiffer(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    energy = distance_series(d, n_d, n_i).compose([conditions.nominal.spring_energy(d, order) for order in range(3)])
    return base(d, i, n_d, n_i) - p["stiffness_error"] * energy


SPRING_STIFFNESS = Effect(
    name="spring_stiffness",
    symptom="The force has a further part in proportion to that of the drawn spring, at any current.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            "stiffness_error",
            bounds=(-1.0, 9.0),
            plausible=(-0.3, 0.3),
            description="True over drawn stiffness of all springs, less one; their free lengths are the drawn ones.",
            words="the spring is {size} {stiffer|softer} than drawn",
        ),
    ),
    needs=("time_s", "~distance_m", "spring"),
    experiment=_BALANCE,
    reference=_REFERENCE,
    coenergy=_stiffer,
    calibrations=(Calibration({"stiffness_error": 0.01}, 20.0, _BALANCE),),
)


SPRING_PRELOAD = Effect(
    name="spring_preload",
    symptom="The body is pushed by the same further force wherever it is, and lifts off at another current.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            "preload",
            bounds=(-10.0, 10.0),
            plausible=(-0.1, 0.1),
            description="True minus drawn push of the springs away from the electromagnet, as a part of the largest "
            "force.",
            words="the spring's preload is {size} {larger|smaller} than drawn",
            scale="force_N",
        ),
    ),
    needs=("time_s", "spring"),
    experiment=_BALANCE,
    reference=_REFERENCE,
    coenergy=lambda base, d, i, n_d, n_i, conditions, p: spring_coenergy(
        base(d, i, n_d, n_i), d, conditions, 0.0, p["preload"] * conditions.nominal.force_N
    ),
    calibrations=(Calibration({"preload": 1e-3}, 20.0, _BALANCE),),
)


def _carried(
    values: Mapping[str, FloatArray], d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters
) -> Mapping[str, FloatArray]:
    if "force_N" not in values:
        return values
    return {**values, "force_N": values["force_N"] - p["share"] * conditions.nominal.spring_push(d)}


SPRING_IN_FORCE = Effect(
    name="spring_in_force",
    symptom="Every force differs from the magnetic one by the force of the drawn spring.",
    acts_on=("sensor",),
    parameters=(
        EffectParameter(
            "share",
            bounds=(-2.0, 2.0),
            plausible=(0.0, 1.2),
            description="Part of the drawn spring's force that the force sensor carries.",
            words="the force sensor carries {signed} of the drawn spring's force as well",
        ),
    ),
    needs=("force_N", "~distance_m", "spring"),
    experiment="Take the spring out and read the force again, the current off.",
    reference=f"{_REFERENCE}; how the sensor is mounted",
    readings=_carried,
)
