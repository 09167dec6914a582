"""The moving part touches a stop at the near or the far end of its travel and is pushed back.

A flat stop is a spring; a rounded one stiffens with the square root of its compression (Hertz). The potential of the
contact joins the co-energy, whose slope is the force.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Effect, EffectParameter, Parameters
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries, distance_series


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
        "",
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
            unit="",
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
