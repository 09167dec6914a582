"""A spring that the drawing lacks: force away from the electromagnet = preload + stiffness (d_max - d).

The preload is the force at the largest distance of the model; a negative one is that of a spring that pulls there. Its
potential joins the co-energy, W' -> W' + preload d - stiffness (d_max - d)^2 / 2, so that a load cell on the body, a
motion and the equilibrium see the same spring. A preload alone, without a stiffness, is a constant force and not this.
"""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries, distance_series

_BALANCE = "Switch the current off and push the body through its travel with a spring balance."


def spring_coenergy(
    base: TaylorSeries, d: FloatArray, conditions: Conditions, stiffness: float, preload: float
) -> TaylorSeries:
    """The co-energy with that of a spring of a stiffness in N/m and a preload in N at the largest distance."""
    room = distance_series(d - conditions.nominal.distance_max_m, *base.orders)
    return base + preload * room - (0.5 * stiffness) * (room * room)


def _coenergy(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    nominal = conditions.nominal
    stiffness, preload = p["stiffness"] * nominal.stiffness_N_per_m, p["preload"] * nominal.force_N
    return spring_coenergy(base(d, i, n_d, n_i), d, conditions, stiffness, preload)


SPRING = Effect(
    name="spring",
    symptom="The force has a further part that is a straight line over the distance, the same at any current.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            "stiffness",
            bounds=(0.0, 100.0),
            plausible=(0.0, 1.0),
            description="Stiffness, as a part of the largest force over the width of the range of distances.",
            words="a spring of {size} that the drawing lacks acts on the body",
            scale="stiffness_N_per_m",
        ),
        EffectParameter(
            "preload",
            bounds=(-100.0, 100.0),
            plausible=(-0.5, 1.0),
            description="Push of the spring at the largest distance, as a part of the largest force.",
            words="the spring {pushes the body away|pulls the body back} with {size} at the largest distance",
            scale="force_N",
            beside="stiffness",
        ),
    ),
    needs=("~distance_m", "force_N|time_s", "no spring"),
    experiment=_BALANCE,
    reference="Hooke's law; Budynas and Nisbett, Shigley's Mechanical Engineering Design (2015), chapter 10",
    coenergy=_coenergy,
    calibrations=(Calibration({"stiffness": 2e-3, "preload": 2e-3}, 30.0, _BALANCE),),
)
