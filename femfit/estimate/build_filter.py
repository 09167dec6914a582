"""The filters that a record goes through: of a free body, and of one that is held."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.estimate.constants import AT_STOP
from femfit.estimate.filter import Filter
from femfit.estimate.kalman_filter import FilterKind, kalman_filter
from femfit.estimate.noise import FilterNoise, default_noise
from femfit.estimate.prepare import Prepared
from femfit.estimate.run_filter import advance, in_fine_steps, substeps, unmoved
from femfit.model.actuator_model import ActuatorModel
from femfit.model.sensors import HALL

FILTERS: dict[str, tuple[FilterKind, bool]] = {
    "ukf": ("ukf", False),
    "ekf": ("ekf", False),
    "ukf4": ("ukf", True),
    "ekf4": ("ekf", True),
}
"""Name -> kind, and whether a bias is a further state."""


def noise_of(prepared: Prepared, noise: FilterNoise | None) -> FilterNoise:
    """Noises as given, or of the model and the record."""
    noise = default_noise(prepared.model) if noise is None else noise
    hall = prepared.noise.get(HALL, noise.hall_V)
    return replace(noise, hall_V=hall, sensors={**prepared.noise, **noise.sensors})


def filter_of(prepared: Prepared, name: str, biases: Sequence[str] | None, noise: FilterNoise) -> Filter:
    """The filter with steps of Runge and Kutta, since an estimate offline is not in a hurry."""
    kind, biased = FILTERS[name]
    chosen: Sequence[str] = ()
    if biased:
        chosen = biases or [r.name for r in prepared.readings if r.unit != "A"][:1] or [prepared.sensors[0]]
    model = prepared.model
    built = kalman_filter(
        model,
        kind,
        sensors=prepared.sensors,
        biases=chosen,
        noise=noise,
        first_deviation_m=_first_deviation(prepared),
    )
    return replace(built, process=in_fine_steps(model, built.process))


def _first_deviation(prepared: Prepared) -> float | None:
    """A filter that does not read the recorded distance starts again from it where every stretch begins with one."""
    distance = prepared.recorded.get("distance_m")
    read = any(reading.column == "distance_m" for reading in prepared.readings)
    if read or distance is None or not np.isfinite(distance[prepared.log.begins]).all():
        return None
    box = prepared.model.validity
    return AT_STOP * (box.distance_max_m - box.distance_min_m)


def resting_filter(prepared: Prepared, built: Filter) -> Filter | None:
    """The same filter of a body that stands still: the current flows as it does in a body that nothing moves."""
    if prepared.resting is None:
        return None
    process = built.process
    transition = partial(_stay, unmoved(prepared.model), substeps(prepared.model))
    covariance = process.process_covariance.copy()
    covariance[:2, :2] = np.diag(np.square(prepared.resting))
    return replace(built, process=replace(process.predicting(transition), process_covariance=covariance))


def _stay(model: ActuatorModel, count: int, states: FloatArray, voltage: FloatArray) -> FloatArray:
    still = states.copy()
    still[:, 1] = 0.0
    moved = advance(model, model, count, still, voltage)
    moved[:, :2] = still[:, :2]
    return moved
