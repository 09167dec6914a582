"""Forces beside the magnetic one: a constant pull (a cable, a tilted guide, a fan), and the stops at the travel's ends.

Their potential joins the co-energy, whose slope is the force: a pull is W' -> W' - pull d. A bench sees it as an offset
of the force sensor, a motion as a lighter or heavier body. A flat stop is a spring; a rounded one stiffens with the
square root of its compression (Hertz).
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries, distance_series

CONSTANT_FORCE = Effect(
    name="constant_force",
    symptom="The body is pulled by the same further force wherever it is and whatever the current.",
    acts_on=("force",),
    parameters=(
        EffectParameter(
            "pull",
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


def _coenergy(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    near, far = conditions.nominal.distance_min_m, conditions.nominal.distance_max_m
    reach = p["reach"] * (far - near)
    result = base(d, i, n_d, n_i)
    for name, power, start, sign in (
        ("near_flat", 1.0, near + reach, -1.0),
        ("near_round", 1.5, near + reach, -1.0),
        ("far_flat", 1.0, far - reach, 1.0),
    ):
        # Compression over reach; its force A c^power has the potential A reach c^(power + 1) / (power + 1)
        compression = np.maximum(0.0, sign * (d - start)) / reach
        touching = np.where(compression > 0.0, compression, 1.0)
        slopes = [
            np.prod(power + 1.0 - np.arange(k)) * np.where(compression > 0.0, touching ** (power + 1.0 - k), 0.0)
            for k in range(n_d + 1)
        ]
        depth = distance_series(compression, n_d, n_i).scaled(distance=sign / reach)
        result = result - (p[name] * conditions.nominal.force_N * reach / (power + 1.0)) * depth.compose(slopes)
    return result


def _stop(name: str, description: str, words: str) -> EffectParameter:
    return EffectParameter(
        name,
        bounds=(0.0, 100.0),
        plausible=(0.0, 1.0),
        description=description,
        words=words,
        scale="force_N",
    )


END_STOP_CONTACT = Effect(
    name="end_stop_contact",
    symptom="The force breaks away from the model within a small distance from one end of the travel, at any current.",
    acts_on=("force",),
    parameters=(
        _stop(
            "near_flat",
            "Push of a flat stop at the smallest distance, as a part of the largest force.",
            "a stop pushes the body away with {size} at the smallest distance",
        ),
        _stop(
            "near_round",
            "The same for a rounded stop.",
            "a rounded stop pushes the body away with {size} at the smallest distance",
        ),
        _stop(
            "far_flat",
            "Push of a flat stop at the largest distance, as a part of the largest force.",
            "a stop pushes the body back with {size} at the largest distance",
        ),
        EffectParameter(
            name="reach",
            bounds=(0.005, 0.9),
            plausible=(0.02, 0.3),
            description="Part of the travel over which the stop is touched.",
            words="it is touched over {size} of the travel",
            null=0.1,
            nonlinear=True,
            scale="travel_m",
        ),
    ),
    needs=("~distance_m", "force_N|time_s"),
    experiment="Measure the force every few hundredths of a millimetre near the stop, the current off.",
    reference="Johnson, Contact Mechanics (1985), section 4.2",
    coenergy=_coenergy,
)
