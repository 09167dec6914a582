"""The moving part conducts flux better than the model has it, so the inductance grows as it comes near.

W' -> W' + (i^2 / 2) dL(d), with dL falling as a power of the distance: slowly for a wide part near the core, as (1/d)^6
for a small part far away, whose moment grows with the coil's field there and is seen through the same field. The field
at the Hall element changes by the same path: i -> i + share h (dB/di) / L, relatively 20 to 40 times as much as the
flux of a coil whose own flux hardly reaches the moving part.
"""

import numpy as np

from femfit.core.amount import amount
from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, Nominal
from femfit.effects.effect import Effect, EffectParameter, Parameters
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries, current_series, distance_series

_POWERS = (1, 3, 6)


def _coenergy(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    distance = distance_series(d / conditions.nominal.distance_min_m, n_d, n_i).scaled(
        distance=1.0 / conditions.nominal.distance_min_m
    )
    increase = 0.0 * distance
    for power in _POWERS:
        amplitude = p[f"increase_{power}"] * conditions.nominal.inductance_H
        value = distance.value
        falls = [amplitude * np.prod(-power - np.arange(k)) * value ** (-power - k) for k in range(n_d + 1)]
        increase = increase + distance.compose(falls)
    current = current_series(i, n_d, n_i)
    if np.isfinite(conditions.nominal.hall_T_per_A):
        current.coefficients[1, 0, 0] = (
            p["hall_share"] * conditions.nominal.hall_T_per_A / conditions.nominal.inductance_H
        )
    return base(d, i, n_d, n_i) + 0.5 * (current * current * increase)


def _words(p: Parameters, nominal: Nominal) -> list[str]:
    increase = sum(p[f"increase_{power}"] for power in _POWERS)
    sense = "larger" if increase >= 0.0 else "smaller"
    return [f"the inductance is {amount(abs(increase), '')} {sense} at the smallest distance"]


POSITION_DEPENDENT_INDUCTANCE = Effect(
    name="position_dependent_inductance",
    symptom="At small distances flux linkage and force have a further part: one in step with the current, the other "
    "with its square.",
    acts_on=("magnetics",),
    parameters=(
        *(
            EffectParameter(
                name=f"increase_{power}",
                bounds=(-0.5, 5.0),
                plausible=(-0.05, 0.5),
                description="Increase of the inductance at the smallest distance, as a part of the model's, falling "
                f"with the power {power} of the distance.",
                scale="inductance_H",
            )
            for power in _POWERS
        ),
        EffectParameter(
            name="hall_share",
            bounds=(-10.0, 200.0),
            plausible=(0.0, 40.0),
            description="Change of the coil's field at the Hall element over that of its flux, both relative.",
            null=20.0,
            nonlinear=True,
        ),
    ),
    needs=("~distance_m", "~current_A|inductance_H", "force_N|flux_linkage_Wb|inductance_H"),
    experiment="Measure the inductance with a small alternating current at several distances, or the force at both "
    "signs of the current: the further part is even in it.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=_coenergy,
    words=_words,
)
