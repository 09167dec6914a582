"""A force on the moving part that the model does not know: a cable's pull, a tilted guide, a fan.

Its potential joins the co-energy, whose slope is the force: W' -> W' - pull d.

References
----------
H. Goldstein, Classical Mechanics (Addison-Wesley, 1980), section 1.1.
"""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries, distance_series


def _coenergy(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    return base(d, i, n_d, n_i) - (p["pull"] * conditions.nominal.force_N) * distance_series(d, n_d, n_i)


CONSTANT_FORCE = Effect(
    name="constant_force",
    symptom="The body is pulled by the same further force wherever it is and whatever the current.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            name="pull",
            unit="",
            lower=-1.0,
            upper=1.0,
            plausible=(-0.05, 0.05),
            description="Further force towards the electromagnet, as a part of the largest force.",
            scale="force_N",
        ),
    ),
    needs=("force_N|time_s",),
    experiment="Take the magnet out of the moving part, or turn the bench by 180 degrees, and read the force again.",
    reference="Newton's second law; H. Goldstein, Classical Mechanics (Addison-Wesley, 1980), section 1.1",
    coenergy=_coenergy,
    calibrations=(
        Calibration(
            {"pull": 1e-3},
            30.0,
            "Put a piece of brass of the same weight in the magnet's place and read the force.",
        ),
    ),
)
"""Force = magnetic force + pull: on a bench as an offset of the sensor, in motion as a lighter or heavier body."""
