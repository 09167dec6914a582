"""The filters that a record goes through: of a free body, and of one that is held."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.filters.filter import Filter
from femfit.filters.kalman_filter import FilterKind, kalman_filter
from femfit.filters.levitation import blocked_by_diodes, fastest_time_constant, kept_between_stops
from femfit.filters.noise import FilterNoise, default_noise, operating_distance
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import LONGEST_STEP, currents_of_same_flux, runge_kutta_step
from femfit.model.sensors import HALL
from femfit.records.constants import AT_STOP
from femfit.replay.constants import UNMOVED_KG
from femfit.replay.prepare import Prepared

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
        explicit=False,
    )
    return in_fine_steps(model, built)


def _first_deviation(prepared: Prepared) -> float | None:
    """A filter that does not read the recorded distance starts again from it where every stretch begins with one."""
    distance = prepared.recorded.get("distance_m")
    read = any(reading.column == "distance_m" for reading in prepared.readings)
    if read or distance is None or not np.isfinite(distance[prepared.log.begins]).all():
        return None
    box = prepared.model.validity
    return AT_STOP * (box.distance_max_m - box.distance_min_m)


def in_fine_steps(model: ActuatorModel, built: Filter) -> Filter:
    """A filter of this model whose prediction takes steps of Runge and Kutta."""
    transition = partial(_advance, model, _substeps(model))
    # Euler's Jacobian is another step's; that of this one by differences, with as many evaluations as a formula takes
    process = replace(built.process, transition=transition, transition_jacobian=None, transition_columns=None)
    return replace(built, process=process)


def _substeps(model: ActuatorModel) -> int:
    if not model.circuits:
        return 1
    fastest = fastest_time_constant(model, operating_distance(model))
    return max(1, int(np.ceil(model.sample_time_s / fastest / LONGEST_STEP)))


def _advance(model: ActuatorModel, substeps: int, states: FloatArray, voltage: FloatArray) -> FloatArray:
    order, ends = model.order, model.require_motion().ends
    moved = runge_kutta_step(model, states[:, :order], voltage, model.sample_time_s, substeps)
    blocked_by_diodes(model, moved)
    moved = np.concatenate([moved, states[:, order:]], axis=1)
    if ends == (-np.inf, np.inf):
        return moved
    beyond = moved[:, 0].copy()
    kept = kept_between_stops(model, _rebounding(model, states, moved))
    turned = np.flatnonzero(kept[:, 0] != beyond)
    if len(turned):  # the flux linkage goes on at U - R i, wherever within the step the body was stopped
        end = 2 + len(model.circuits)
        kept[turned, 2:end] = currents_of_same_flux(model, kept[turned, 2:end], beyond[turned], kept[turned, 0])
    return blocked_by_diodes(model, kept)


def _rebounding(model: ActuatorModel, before: FloatArray, after: FloatArray) -> FloatArray:
    """What arrives at a stop goes back with the part of its speed that the stop returns; changes ``after``.

    Not where it would be back within the step: what presses it to the stop then keeps it there.
    """
    motion = model.require_motion()
    for stop, outward in ((motion.near_stop, -1.0), (motion.far_stop, 1.0)):
        if stop is None or not stop.restitution:
            continue
        beyond = outward * (after[:, 0] - stop.distance_m)
        gained = outward * (after[:, 1] - before[:, 1])
        hits = (beyond >= 0.0) & (outward * (before[:, 0] - stop.distance_m) < 0.0)
        hits &= 2.0 * stop.restitution * outward * after[:, 1] > gained
        after[:, 0] = np.where(hits, stop.distance_m - outward * stop.restitution * beyond, after[:, 0])
        after[:, 1] = np.where(hits, -stop.restitution * after[:, 1], after[:, 1])
    return after


def resting_filter(prepared: Prepared, built: Filter) -> Filter | None:
    """The same filter of a body that stands still: the current flows as it does in a body that nothing moves."""
    if prepared.resting is None:
        return None
    model, process = prepared.model, built.process
    still = replace(
        model.require_motion(), mass_kg=UNMOVED_KG, gravity_m_s2=0.0, near_stop=None, far_stop=None, coulomb_N=0.0
    )
    transition = partial(_stay, replace(model, motion=still), _substeps(model))
    covariance = process.process_covariance.copy()
    covariance[:2, :2] = np.diag(np.square(prepared.resting))
    resting = replace(process, transition=transition, transition_jacobian=None, process_covariance=covariance)
    return replace(built, process=resting)


def _stay(model: ActuatorModel, substeps: int, states: FloatArray, voltage: FloatArray) -> FloatArray:
    still = states.copy()
    still[:, 1] = 0.0
    moved = _advance(model, substeps, still, voltage)
    moved[:, :2] = still[:, :2]
    return moved
