"""The currents at which the magnetic force balances weight, springs and load.

One current is found by bisection. With several there are infinitely many: the ones taken lie nearest to a bias, the
heat of each deviation counted, R (i - b)^2. About the bias they move along the direction in which the least heat gives
the most force, which is the differential one of a symmetric bearing.

References
----------
G. Schweitzer and E. H. Maslen (eds.), Magnetic Bearings (Springer, 2009), section 4.2: differential driving about a
bias current of half the largest one.
"""

from functools import partial

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError
from femfit.model.actuator_model import ActuatorModel

HARDLY_MOVES = 0.01
"""Conventional: a bias at which no current gives this part of the largest dF/di of the domain leaves the force without
a hold, as no current at all does where there is no magnet."""

STEPS = 100
"""Conventional: Newton's method needs five for a quadratic force."""


def holding_currents(model: ActuatorModel, distance: float, bias_A: FloatArray | None = None) -> FloatArray:
    """Currents of all circuits at which the force balances weight, springs and load, shape (n,).

    Parameters
    ----------
    distance : float
        In m.
    bias_A : array, shape (n,), or None
        What the currents of several circuits are nearest to; :func:`bias_currents` where None.

    Raises
    ------
    DomainError
        If no currents of the validity domain hold the body there. Magnets alone are not asked to.
    """
    if not model.require_circuits():
        return np.zeros(0)
    if len(model.circuits) == 1:
        return np.array([holding_current(model, distance)])
    needed, limits = float(model.require_motion().static_force(np.asarray(distance))), model.validity.current_limits_A
    bias = bias_currents(model, distance) if bias_A is None else np.asarray(bias_A, dtype=np.float64)
    model.validity.require(np.asarray(distance), bias)
    worth, currents = 1.0 / model.resistances_ohm, bias.copy()
    scale = max(abs(needed), float(np.abs(model.magnetics.force(*model.validity.grid(5, 3))).max()))
    for _ in range(STEPS):
        at = model.magnetics.state(np.asarray(distance), currents)
        missing = needed - float(at.force)
        if abs(missing) <= 1e-12 * scale:
            break
        # The nearest point to the bias on the force's tangent plane
        along = worth * at.motional_constant
        strength = float(at.motional_constant @ along)
        back = currents - bias
        currents = bias + along * ((missing + float(at.motional_constant @ back)) / strength) if strength else currents
        currents = np.clip(currents, limits[:, 0], limits[:, 1])
    if abs(missing) > 1e-9 * scale:
        ranges = ", ".join(
            f"{low:g}..{high:g} A of {name}" for name, (low, high) in zip(model.circuit_names, limits, strict=True)
        )
        raise DomainError(
            f"A body of {1e3 * model.require_motion().mass_kg:g} g must be held at {1e3 * distance:g} mm by currents "
            f"within {ranges}, where the model was fitted, about a bias of {', '.join(f'{one:g} A' for one in bias)}; "
            f"the force comes to {needed - missing:g} N of {needed:g} N. Choose another distance, or sweep wider."
        )
    return currents


def bias_currents(model: ActuatorModel, distance: float) -> FloatArray:
    """The middle of each current's range, or half of the largest where no current moves the force there."""
    limits = model.validity.current_limits_A
    widths, middle = np.ptp(limits, axis=1), limits.mean(axis=1)
    each = np.stack(np.meshgrid(*limits), axis=-1).reshape(-1, len(limits))
    at = np.full(len(each) + 1, distance)
    motional = model.magnetics.state(at, np.vstack([middle, each])).motional_constant
    strength = np.abs(motional * widths).max(axis=1)
    if strength[0] >= HARDLY_MOVES * strength.max():
        return np.asarray(middle)
    return np.asarray(middle + 0.25 * widths)


def holding_current(model: ActuatorModel, distance: float) -> float:
    """The same of one circuit."""
    motion, box = model.require_motion(), model.validity
    model.validity.require(np.asarray(distance), np.asarray(box.current_min_A))
    needed = float(motion.static_force(np.asarray(distance)))
    against = "weight, springs and load" if motion.springs or motion.load_N else "a weight"

    force = partial(_force, model, distance)
    lower, upper = model.attracting_range(box.current_min_A, box.current_max_A)
    rising = force(upper) > force(lower)
    if not min(force(lower), force(upper)) <= needed <= max(force(lower), force(upper)):
        raise DomainError(
            f"A body of {1e3 * motion.mass_kg:g} g must be held at {1e3 * distance:g} mm by a current of "
            f"{box.current_min_A:g}..{box.current_max_A:g} A, where the model was fitted; its forces there are "
            f"{force(lower):g} to {force(upper):g} N against {against} of {needed:g} N. Choose another distance or "
            "sweep wider."
        )
    while True:
        middle = 0.5 * (lower + upper)
        if middle in {lower, upper}:
            return middle
        lower, upper = (middle, upper) if (force(middle) < needed) == rising else (lower, middle)


def _force(model: ActuatorModel, distance: float, current: float) -> float:
    return float(model.magnetics.force(np.asarray(distance), np.asarray(current)))
