"""Forces beside the magnetic one, whose potential joins the co-energy: its slope is the force.

``spring``
    A spring that the drawing lacks, beside what it has: force away from the electromagnet = preload + stiffness
    (d_max - d). The preload is the force at the largest distance of the model; a negative one is that of a spring that
    pulls there. With W' -> W' + preload d - stiffness (d_max - d)^2 / 2 a load cell on the body, a motion and the
    equilibrium see the same spring. A preload alone, without a stiffness, is a constant force and not this.

``spring_stiffness``, ``spring_preload``, ``spring_in_force``
    The spring of the drawing is another one, or the force sensor carries it. Stiffer by a part e, as of thicker wire, a
    spring has no force at the same free length and 1 + e times the drawn force anywhere else: its further energy is
    e U(d), also of several springs and of a force table. Another preload is a further constant. A model's force is the
    magnetic one; a load cell between spring and frame reads that, one that holds the body reads the spring as well.

``constant_force``
    A constant pull (a cable, a tilted guide, a fan): W' -> W' - pull d. A bench sees it as an offset of the force
    sensor, a motion as a lighter or heavier body.

``end_stop_contact``
    The stops at the travel's ends. A flat stop is a spring; a rounded one stiffens with the square root of its
    compression (Hertz).
"""

import casadi as ca
from casadi import SX

from femfit.core.graph import Expression
from femfit.effects.effect import Calibration, Effect, EffectPoint, effect_of, in_channel, parameter_of


def _energy(point: EffectPoint) -> Expression:
    nominal, room = point.nominal, point.d - point.nominal.distance_max_m
    stiffness, preload = point.p["stiffness"] * nominal.stiffness_N_per_m, point.p["preload"] * nominal.force_N
    return 0.5 * stiffness * room**2 - preload * room


SPRING = Effect(
    name="spring",
    symptom="The force has a further part that is a straight line over the distance, the same at any current.",
    parameters=(
        parameter_of(
            "stiffness",
            limits=(0.0, 0.0, 1.0, 100.0),
            description="Stiffness, as a part of the largest force over the width of the range of distances.",
            words="a spring of {size} that the drawing lacks acts on the body",
            scale="stiffness_N_per_m",
        ),
        parameter_of(
            "preload",
            limits=(-100.0, -0.5, 1.0, 100.0),
            description="Push of the spring at the largest distance, as a part of the largest force.",
            words="the spring {pushes the body away|pulls the body back} with {size} at the largest distance",
            scale="force_N",
            beside="stiffness",
        ),
    ),
    needs=("~distance_m", "force_N|time_s"),
    experiment="Switch the current off and push the body through its travel with a spring balance.",
    reference="Hooke's law; Budynas and Nisbett, Shigley's Mechanical Engineering Design (2015), chapter 10",
    energy=_energy,
    calibrations=(Calibration({"stiffness": 2e-3, "preload": 2e-3}, 30.0),),
)


_DRAWN_SPRING_BALANCE = "Take the spring out and read its force at two lengths with a spring balance."
_REFERENCE = "Budynas and Nisbett, Shigley's Mechanical Engineering Design (2015), chapter 10"


SPRING_STIFFNESS = effect_of(
    name="spring_stiffness",
    symptom="The force has a further part in proportion to that of the drawn spring, at any current.",
    parameter="stiffness_error",
    limits=(-1.0, -0.3, 0.3, 9.0),
    description="True over drawn stiffness of all springs, less one; their free lengths are the drawn ones.",
    words="the spring is {size} {stiffer|softer} than drawn",
    needs=("time_s", "~distance_m", "spring"),
    experiment=_DRAWN_SPRING_BALANCE,
    reference=_REFERENCE,
    energy=lambda point: point.p["stiffness_error"] * point.nominal.spring_energy(point.d),
    read=(0.01, 20.0),
)


SPRING_PRELOAD = effect_of(
    name="spring_preload",
    symptom="The body is pushed by the same further force wherever it is, and lifts off at another current.",
    parameter="preload",
    limits=(-10.0, -0.1, 0.1, 10.0),
    description="True minus drawn push of the springs away from the electromagnet, as a part of the largest force.",
    words="the spring's preload is {size} {larger|smaller} than drawn",
    scale="force_N",
    needs=("time_s", "spring"),
    experiment=_DRAWN_SPRING_BALANCE,
    reference=_REFERENCE,
    energy=lambda point: -point.p["preload"] * point.nominal.force_N * (point.d - point.nominal.distance_max_m),
    read=(1e-3, 20.0),
)


SPRING_IN_FORCE = effect_of(
    name="spring_in_force",
    symptom="Every force differs from the magnetic one by the force of the drawn spring.",
    parameter="share",
    limits=(-2.0, 0.0, 1.2, 2.0),
    description="Part of the drawn spring's force that the force sensor carries.",
    words="the force sensor carries {signed} of the drawn spring's force as well",
    needs=("force_N", "~distance_m", "spring"),
    experiment="Take the spring out and read the force again, the current off.",
    reference=f"{_REFERENCE}; how the sensor is mounted",
    readings=in_channel("force_N", lambda f, point: f - point.p["share"] * point.nominal.push_of_springs(point.d)),
)


CONSTANT_FORCE = effect_of(
    name="constant_force",
    symptom="The body is pulled by the same further force wherever it is and whatever the current.",
    parameter="pull",
    limits=(-1.0, -0.05, 0.05, 1.0),
    description="Further force towards the electromagnet, as a part of the largest force.",
    words="a further force of {size} {pulls the body towards|pushes the body away from} the electromagnet",
    scale="force_N",
    needs=("force_N|time_s",),
    experiment="Put a body of the same weight that is not magnetic in the moving part's place and hold it by a spring "
    "balance.",
    reference="Newton's second law; H. Goldstein, Classical Mechanics (Addison-Wesley, 1980), section 1.1",
    energy=lambda point: point.p["pull"] * point.nominal.force_N * point.d,
    read=(1e-3, 30.0),
)


def _energy_of_stops(point: EffectPoint) -> Expression:
    near, far = point.nominal.distance_min_m, point.nominal.distance_max_m
    reach, energy = point.p["reach"] * (far - near), 0.0
    for name, power, start, sign in (
        ("near_flat", 1.0, near + reach, -1.0),
        ("near_round", 1.5, near + reach, -1.0),
        ("far_flat", 1.0, far - reach, 1.0),
    ):
        # Compression over reach; its force A c^power has the potential A reach c^(power + 1) / (power + 1)
        compression = SX(sign * (point.d - start) / reach)
        touched = ca.if_else(compression > 0.0, compression ** (power + 1.0), 0.0)
        energy = energy + point.p[name] * point.nominal.force_N * reach / (power + 1.0) * touched
    return energy


END_STOP_CONTACT = Effect(
    name="end_stop_contact",
    symptom="The force breaks away from the model within a small distance from one end of the travel, at any current.",
    parameters=(
        *(
            parameter_of(name, limits=(0.0, 0.0, 1.0, 100.0), description=description, words=words, scale="force_N")
            for name, description, words in (
                (
                    "near_flat",
                    "Push of a flat stop at the smallest distance, as a part of the largest force.",
                    "a stop pushes the body away with {size} at the smallest distance",
                ),
                (
                    "near_round",
                    "The same for a rounded stop.",
                    "a rounded stop pushes the body away with {size} at the smallest distance",
                ),
                (
                    "far_flat",
                    "Push of a flat stop at the largest distance, as a part of the largest force.",
                    "a stop pushes the body back with {size} at the largest distance",
                ),
            )
        ),
        parameter_of(
            "reach",
            limits=(0.005, 0.02, 0.3, 0.9),
            description="Part of the travel over which the stop is touched.",
            words="it is touched over {size} of the travel",
            usual=0.1,
            scale="travel_m",
        ),
    ),
    needs=("~distance_m", "force_N|time_s"),
    experiment="Measure the force every few hundredths of a millimetre near the stop, the current off.",
    reference="Johnson, Contact Mechanics (1985), section 4.2",
    energy=_energy_of_stops,
)
