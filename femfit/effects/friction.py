"""Friction against the motion, and where it ends.

``coulomb_friction``, ``viscous_friction``, ``fluid_drag``
    Dry, whatever the speed and larger where it starts, or growing with the velocity. Force towards the electromagnet =
    level weight sign(v), rounded at small speeds, damping m v of an oil film or of eddy currents, or drag m |v| v of a
    fluid that is displaced; v > 0 is falling away.

``side_pull_friction``
    Dry friction of a guide that the side pull presses on. A plunger off its bore's axis is pulled sideways with a force
    that grows with the flux density squared. That force is no part of an axisymmetric field; at one distance and below
    saturation it goes with the current squared.

``stop_position``
    A stop stands elsewhere than drawn: it is worn, or a shim is missing under it. Where a body rests on a stop, the
    recorded distance reads the stop's place. An error of the distance's zero shows there as well, but it changes the
    forces too; a stop's does not.
"""

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.text import amount
from femfit.effects.conditions import Nominal
from femfit.effects.effect import Calibration, Effect, EffectPoint, Parameters, effect_of, in_channel, parameter_of


def _force(point: EffectPoint) -> FloatArray:
    v, weight = point.velocity, point.nominal.weight_N
    level = point.p["level"] + point.p["breakaway"] * np.exp(-((v / (10.0 * point.p["creep_m_s"])) ** 2))
    return weight * level * np.tanh(v / point.p["creep_m_s"])


COULOMB_FRICTION = Effect(
    name="coulomb_friction",
    symptom="The body sticks: it answers small changes late or not at all, and stops short.",
    parameters=(
        parameter_of(
            "level",
            limits=(-0.05, 0.0, 0.5, 5.0),
            description="Friction as a part of the body's weight.",
            words="dry friction brakes with {signed}",
            scale="weight_N",
        ),
        parameter_of(
            "breakaway",
            limits=(-0.05, 0.0, 0.3, 5.0),
            description="Further friction at small speeds, as a part of the body's weight.",
            words="it takes {size} {more|less} to start",
            scale="weight_N",
        ),
        parameter_of(
            "creep_m_s",
            unit="m/s",
            limits=(1e-5, 3e-4, 3e-3, 0.1),
            description="Speed at which the friction has 76 % of its level.",
            usual=1e-3,
        ),
    ),
    needs=("time_s", "distance_m|hall_V"),
    experiment="Pull the body slowly along its guide in both directions with a force sensor, the coil open.",
    reference="Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083",
    force=_force,
    calibrations=(Calibration({"level": 0.01, "breakaway": 0.02}, 40.0),),
)


VISCOUS_FRICTION = effect_of(
    name="viscous_friction",
    symptom="Oscillations die out faster than the model's.",
    parameter="damping_per_s",
    limits=(-10.0, 0.0, 50.0, 1e4),
    description="Damping constant over the model's mass: without other forces the velocity falls at this rate.",
    needs=("time_s", "distance_m|hall_V"),
    experiment="Let the body swing on a spring, the coil open, and record how its amplitude falls.",
    reference="H. Goldstein, Classical Mechanics (Addison-Wesley, 1980), section 1.5",
    force=lambda point: point.p["damping_per_s"] * point.nominal.mass_kg * point.velocity,
    read=(0.5, 60.0),
    words=lambda p, nominal: [f"friction brakes with {amount(p['damping_per_s'] * nominal.mass_kg, 'N')} at 1 m/s"],
)


FLUID_DRAG = effect_of(
    name="fluid_drag",
    symptom="Fast strokes take longer than the model's, slow ones do not.",
    parameter="drag_per_m",
    limits=(-10.0, 0.0, 200.0, 1e6),
    description="Drag over the model's mass and the velocity squared.",
    needs=("time_s", "distance_m|hall_V"),
    experiment="Repeat a fast stroke in air, or with the ports of the fluid open, and compare its time.",
    reference="Batchelor, An Introduction to Fluid Dynamics (1967), section 5.11",
    force=lambda point: point.p["drag_per_m"] * point.nominal.mass_kg * np.abs(point.velocity) * point.velocity,
    words=lambda p, nominal: [
        f"a fluid brakes with {amount(p['drag_per_m'] * nominal.mass_kg, 'N')} at 1 m/s, with the square of the speed"
    ],
)


_CREEP_M_S = 1e-3
"""Assumed: speed at which the friction has 76 % of its level, the usual one of dry friction."""


def _force_of_side_pull_friction(point: EffectPoint) -> FloatArray:
    nominal = point.nominal
    pressed = nominal.force_N * (point.i / (nominal.peak_current_A or 1.0)) ** 2
    return point.p["share"] * pressed * np.tanh(point.velocity / _CREEP_M_S)


SIDE_PULL_FRICTION = effect_of(
    name="side_pull_friction",
    symptom="The body sticks the more, the larger the current; without current it slides as it should.",
    parameter="share",
    limits=(-0.02, 0.0, 0.2, 2.0),
    description="Friction at the largest current, as a part of the largest force.",
    words="the guide brakes with {size} at the largest current",
    scale="force_N",
    needs=("time_s", "distance_m|hall_V", "~current_A", "iron"),
    experiment="Pull the body slowly along its guide in both directions with a force sensor, without current and at a "
    "large one.",
    reference="H. C. Roters, Electromagnetic Devices (Wiley, 1941), chapter 9 (side thrust of eccentric plungers)",
    force=_force_of_side_pull_friction,
    read=(5e-3, 40.0),
)


REST = "rest_distance_m"
"""The channel of a record that reads a stop's place: the distance while the body rests on it."""


def _moved(rest: FloatArray, point: EffectPoint) -> FloatArray:
    nominal = point.nominal
    near, far = nominal.stops_m
    nearer = np.abs(point.d - near) < np.abs(point.d - far)
    moved = np.where(nearer, float(point.p["near"]), float(point.p["far"]))
    return rest + nominal.travel_m * moved


def _ends(ends: tuple[float, float], nominal: Nominal, p: Parameters) -> tuple[float, float]:
    return ends[0] + p["near"] * nominal.travel_m, ends[1] + p["far"] * nominal.travel_m


STOP_POSITION = Effect(
    name="stop_position",
    symptom="The body comes to rest before or behind the distance at which its stop is drawn.",
    acts_on=("motion",),
    parameters=tuple(
        parameter_of(
            name,
            limits=(-0.5, -0.05, 0.05, 0.5),
            description=f"True less drawn distance of the {name} stop, as a part of the width of the range of "
            "distances.",
            words=f"the {name} stop stands {{size}} {{further away|nearer}} than drawn",
            scale="travel_m",
        )
        for name in ("near", "far")
    ),
    needs=("time_s", "stop", REST),
    experiment="Press the body against each stop and measure by a depth gauge how far it is from the fixed part's "
    "face.",
    reference="Johnson, Contact Mechanics (1985), chapter 1 (what a contact's place is)",
    readings=in_channel(REST, _moved),
    ends=_ends,
    calibrations=(Calibration({"near": 2e-3, "far": 2e-3}, 10.0),),
)
