"""A force on the moving part that the model does not know: a cable's pull, a tilted guide, a fan.

Its potential joins the co-energy, whose slope is the force: W' -> W' - pull d. A bench sees it as an offset of the
force sensor, a motion as a lighter or heavier body.
"""

from femfit.effects.effect import Calibration, Effect, EffectParameter
from femfit.effects.taylor_series import distance_series

CONSTANT_FORCE = Effect(
    name="constant_force",
    symptom="The body is pulled by the same further force wherever it is and whatever the current.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            "pull",
            "",
            bounds=(-1.0, 1.0),
            plausible=(-0.05, 0.05),
            description="Further force towards the electromagnet, as a part of the largest force.",
            words="a further force of {size} {pulls the body towards|pushes the body away from} the electromagnet",
            scale="force_N",
        ),
    ),
    needs=("force_N|time_s",),
    experiment="Turn the bench by 180 degrees, or couple the body to a spring balance with everything switched off, "
    "and read the force again.",
    reference="Newton's second law; H. Goldstein, Classical Mechanics (Addison-Wesley, 1980), section 1.1",
    coenergy=lambda base, d, i, n_d, n_i, conditions, p: (
        base(d, i, n_d, n_i) - (p["pull"] * conditions.nominal.force_N) * distance_series(d, n_d, n_i)
    ),
    calibrations=(
        Calibration(
            {"pull": 1e-3},
            30.0,
            "Put a body of the same weight that is not magnetic in the moving part's place and hold it by a spring "
            "balance.",
        ),
    ),
)
