"""A stop stands elsewhere than drawn: it is worn, or a shim is missing under it.

Where a body rests on a stop, the recorded distance reads the stop's place. An error of the distance's zero shows there
as well, but it changes the forces too; a stop's does not.
"""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, Nominal
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters

REST = "rest_distance_m"
"""The channel of a record that reads a stop's place: the distance while the body rests on it."""

_GAUGE = "Press the body against each stop and measure by a depth gauge how far it is from the fixed part's face."


def _moved(
    values: Mapping[str, FloatArray], d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters
) -> Mapping[str, FloatArray]:
    if REST not in values:
        return values
    nominal = conditions.nominal
    near, far = nominal.stops_m
    at_near = np.abs(d - near) < np.abs(d - far)
    return {**values, REST: values[REST] + nominal.travel_m * np.where(at_near, p["near"], p["far"])}


def _ends(ends: tuple[float, float], nominal: Nominal, p: Parameters) -> tuple[float, float]:
    return ends[0] + p["near"] * nominal.travel_m, ends[1] + p["far"] * nominal.travel_m


def _stop(name: str) -> EffectParameter:
    return EffectParameter(
        name,
        bounds=(-0.5, 0.5),
        plausible=(-0.05, 0.05),
        description=f"True less drawn distance of the {name} stop, as a part of the width of the range of distances.",
        words=f"the {name} stop stands {{size}} {{further away|nearer}} than drawn",
        scale="travel_m",
    )


STOP_POSITION = Effect(
    name="stop_position",
    symptom="The body comes to rest before or behind the distance at which its stop is drawn.",
    acts_on=("motion",),
    parameters=(_stop("near"), _stop("far")),
    needs=("time_s", "stop", REST),
    experiment=_GAUGE,
    reference="Johnson, Contact Mechanics (1985), chapter 1 (what a contact's place is)",
    readings=_moved,
    ends=_ends,
    calibrations=(Calibration({"near": 2e-3, "far": 2e-3}, 10.0, _GAUGE),),
)
