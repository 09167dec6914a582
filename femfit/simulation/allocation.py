"""Which currents give a force: the only one of one circuit, or of several those that heat least about a bias.

One circuit: F(d, i) = F by Newton's iteration. Several circuits have a current to spare for each one after the first.
Theirs are the currents nearest to bias currents b in the copper's loss,

    minimise sum R_k (i_k - b_k)^2    with F(d, i) = F,    so that    i = b + mu R^-1 k_m(d, i),

found as at rest, by :func:`femfit.estimate.holding.nearest_currents`. A bias makes the force of two magnets that pull
against each other linear: about it their currents change by equal and opposite amounts.

Distances have the shape (N,), forces (N,), currents (N, n).

The commands that a controller may give: the drivers' range, as far as the currents stay where the model was fitted.

A driver of 24 V on a winding of 1.4 ohm may need its voltage to change the current, and would leave the swept currents
at once if it were held. So the voltage is kept between those that bring the current within a sample to the ends of the
covered range, U = R i + L (i_end - i)/t - k_m v without effects.

References
----------
G. Schweitzer and E. H. Maslen (eds.), Magnetic Bearings (Springer, 2009), section 4.1.4 (differential driving mode).
"""

from itertools import product

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.results import remembered
from femfit.estimate.holding import bias_currents, nearest_currents
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import command_limits, commands_currents, held_limits
from femfit.model.dynamics import voltages_needed
from femfit.simulation.constants import COVERED_PART

_NEWTON_STEPS, _STEPS_FROM_NEAR = 40, 5

EVEN_PART = 0.05
"""Conventional: a circuit whose force per current vanishes without current, to this part of its largest, attracts with
either sign; only the positive one is used, so that its current does not pass through the point without effect."""


@remembered
def current_ranges(model: ActuatorModel) -> FloatArray:
    """The currents in A that the drivers can hold and the model covers, of shape (n, 2).

    Of one circuit from the weakest force to the largest: steel alone is attracted by either sign of the current, so
    that its range begins at zero.
    """
    box = model.validity
    held = [held_limits(circuit) for circuit in model.circuits]
    result = np.array([(max(a, c), min(b, d)) for (a, b), (c, d) in zip(box.current_limits_A, held, strict=True)])
    if len(result) == 1:
        return np.array([model.attracting_range(*result[0].tolist())])
    middle = np.full(2, 0.5 * (box.distance_min_m + box.distance_max_m))
    idle, busy = np.abs(model.magnetics.motional_constant(middle, np.stack([0.0 * result[:, 1], result[:, 1]])))
    result[(idle < EVEN_PART * busy) & (result[:, 0] < 0.0), 0] = 0.0
    return result


def force_range(model: ActuatorModel, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weakest and strongest force in N at distances in m, with the currents at the ends of :func:`current_ranges`."""
    forces = [
        model.magnetics.force(distance, np.tile(currents, (len(distance), 1)))
        for currents in product(*current_ranges(model))
    ]
    return np.min(forces, axis=0), np.max(forces, axis=0)


@remembered
def _bias(model: ActuatorModel) -> FloatArray:
    box = model.validity
    return np.clip(bias_currents(model, 0.5 * (box.distance_min_m + box.distance_max_m)), *current_ranges(model).T)


def currents_for_force(
    model: ActuatorModel,
    distance: FloatArray,
    force: FloatArray,
    near: FloatArray | None = None,
) -> FloatArray:
    """Currents that give a force, within :func:`current_ranges`; where none give it, those that come near to it.

    One circuit's is found by Newton's iteration from the current of the largest force: dF/di rises towards it in an
    unsaturated actuator, so that it approaches the root from one side. From currents ``near`` the solution a few steps
    are tried first; they are where several circuits look alone, so that a loop does not jump to far ones.
    """
    if len(model.circuits) == 1:
        current = strongest = np.full(np.shape(distance), np.inf if _rises(model) else -np.inf)
        converged = np.zeros(np.shape(distance), dtype=np.bool_)
        if near is not None:
            current, converged = _newton(model, distance, force, near[..., 0], _STEPS_FROM_NEAR)
        if not converged.all():
            current = np.where(converged, current, _newton(model, distance, force, strongest, _NEWTON_STEPS)[0])
        return current[..., None]
    distance, force = np.broadcast_arrays(np.asarray(distance, float), np.asarray(force, float))
    start = None if near is None else np.reshape(near, (distance.size, -1))
    currents = nearest_currents(model, distance.ravel(), force.ravel(), _bias(model), current_ranges(model), start)
    return currents.reshape(*distance.shape, -1)


def currents_for_acceleration(
    model: ActuatorModel,
    distance: FloatArray,
    acceleration: FloatArray,
    velocity: FloatArray | float = 0.0,
    near: FloatArray | None = None,
) -> FloatArray:
    """Currents for which F(d, i) = F_0(d) - c v - m a, a along growing distance, as :func:`currents_for_force`.

    Dry friction is left to the feedback: taken from an estimate of the velocity it would chatter about rest.
    """
    force = model.require_motion().force_to_accelerate(distance, velocity, acceleration)
    return currents_for_force(model, distance, force, near)


@remembered
def _rises(model: ActuatorModel) -> bool:
    """Whether a larger current attracts more, in the middle of the distances."""
    box = model.validity
    low, high = current_ranges(model)[0].tolist()
    middle = np.full(2, 0.5 * (box.distance_min_m + box.distance_max_m))
    weak, strong = model.magnetics.force(middle, np.array([[low], [high]]))
    return bool(strong >= weak)


def _newton(
    model: ActuatorModel, distance: FloatArray, force: FloatArray, start: FloatArray, steps: int
) -> tuple[FloatArray, BoolArray]:
    """Currents, and which converged; each stops by itself, so that it does not depend on the others."""
    low, high = current_ranges(model)[0].tolist()
    sign = 1.0 if _rises(model) else -1.0
    scale = max(abs(low), abs(high))  # the range may end at zero: a magnet that a negative current holds back
    current = np.clip(start, low, high)
    changing, pull_of = np.ones(np.shape(distance), dtype=np.bool_), model.magnetics.at_distances(distance)
    for _ in range(steps):
        pull, motional = pull_of(current[..., None])
        least = 1e-12 * np.abs(pull) / scale + np.finfo(np.float64).tiny
        slope = sign * np.maximum(sign * motional[..., 0], least)
        updated = np.where(changing, np.clip(current - (pull - force) / slope, low, high), current)
        changing = np.abs(updated - current) > 1e-6 * scale  # the next change would be its square
        current = updated
        if not changing.any():
            break
    return current, ~changing


@remembered
def limits_of(model: ActuatorModel) -> FloatArray:
    """Least and largest command of each circuit, of shape (2, n)."""
    return np.array([command_limits(circuit) for circuit in model.circuits]).T


@remembered
def covered_currents(model: ActuatorModel) -> FloatArray:
    """Currents that a controller may ask for, of shape (2, n); infinite where the driver gives none beyond anyway."""
    widths = model.validity.current_limits_A[: len(model.circuits)].T
    margin = (1.0 - COVERED_PART) * np.abs(widths).max(axis=0)
    low, high = widths[0] + margin, widths[1] - margin
    one_sided = [(circuit.voltage_min_V >= 0.0, circuit.voltage_max_V <= 0.0) for circuit in model.circuits]
    kept_low, kept_high = np.array(one_sided).T
    # Currents of a driver of one sign cannot pass a sweep that ends at zero
    low = np.where(kept_low & (widths[0] >= 0.0) & (widths[0] <= margin), -np.inf, low)
    high = np.where(kept_high & (widths[1] <= 0.0) & (widths[1] >= -margin), np.inf, high)
    return np.stack([low, high])


def limited(model: ActuatorModel, estimate: FloatArray, command: FloatArray) -> FloatArray:
    """Commands of shape (runs, n) within the drivers' limits and the covered currents, from estimates (runs, 2 + n)."""
    low, high = limits_of(model)
    amplified = commands_currents(model)
    if amplified.all():
        return np.clip(command, low, high)
    box = model.validity
    distance = np.clip(estimate[:, 0], box.distance_min_m, box.distance_max_m)
    currents = np.clip(estimate[:, 2:], *box.current_limits_A[: command.shape[1]].T)
    volts, inductance = voltages_needed(model, distance, estimate[:, 1], currents)
    reach_V = np.einsum("rkk->rk", inductance) / model.sample_time_s
    ends = [
        np.where(amplified, limit, volts + reach_V * (end - currents))
        for limit, end in zip((low, high), covered_currents(model), strict=True)
    ]
    return np.clip(np.clip(command, ends[0], ends[1]), low, high)
