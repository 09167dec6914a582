"""The currents at which the magnetic force balances weight, springs and load.

One circuit has one such current where the force grows with it. Several have infinitely many: the ones taken lie nearest
to a bias, the heat of each deviation counted, R (i - b)^2. About the bias they move along the direction in which the
least heat gives the most force, which is the differential one of a symmetric bearing.

References
----------
G. Schweitzer and E. H. Maslen (eds.), Magnetic Bearings (Springer, 2009), section 4.2: differential driving about a
bias current of half the largest one.
"""

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import ForceOfCurrents

HARDLY_MOVES = 0.01
"""Conventional: a bias at which no current gives this part of the largest dF/di of the domain leaves the force without
a hold, as no current at all does where there is no magnet."""

STEPS = 100
"""Conventional: Newton's method needs five for a quadratic force."""

BALANCED = 1e-9
"""Conventional: part of the largest force by which the currents may miss the one that is needed."""

CORRECTIONS = 8
"""Derived: Newton's method doubles its digits with each step, so that five suffice from one digit."""

CONVERGED = 1e-12
"""Derived: change of the currents, over the largest, that rounding makes."""

NEAR = 1e-6
"""Derived: so near to the currents of least heat it costs the square of this more, and the force is balanced after."""


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
    needed, limits = float(model.require_motion().static_force(np.asarray(distance))), model.validity.current_limits_A
    several = len(model.circuits) > 1
    limits = limits if several else np.array([model.attracting_range(*limits[0].tolist())])
    bias = bias_currents(model, distance) if bias_A is None else np.asarray(bias_A, dtype=np.float64)
    bias = bias if several else np.clip(bias, *limits.T)
    model.validity.require(np.asarray(distance), bias)
    currents = nearest_currents(model, np.array([distance]), np.array([needed]), bias, limits)[0]
    missing = needed - float(model.magnetics.force(np.asarray(distance), currents))
    if abs(missing) <= BALANCED * max(abs(needed), model.peaks[0]):
        return np.asarray(currents)
    ranges = ", ".join(
        f"{low:g}..{high:g} A of {name}" for name, (low, high) in zip(model.circuit_names, limits, strict=True)
    )
    about = ", ".join(f"{current:g} A" for current in bias)
    raise DomainError(
        f"A body of {1e3 * model.require_motion().mass_kg:g} g must be held at {1e3 * distance:g} mm by currents "
        f"within {ranges}, where the model was fitted{f', about a bias of {about}' if several else ''}; the force "
        f"comes to {needed - missing:g} N of the {needed:g} N of weight, springs and load. Choose another distance, or "
        "sweep wider."
    )


def nearest_currents(
    model: ActuatorModel,
    distance: FloatArray,
    force: FloatArray,
    bias: FloatArray,
    limits: FloatArray,
    start: FloatArray | None = None,
) -> FloatArray:
    """Currents of several circuits that give a force, those nearest to a bias; the nearest ones where none give it.

    Where the way from the bias ends without the force, the corners of the limits are tried as starts too.

    Parameters
    ----------
    distance, force : array, shape (N,)
        In m and N.
    bias : array, shape (n,)
        Within the limits.
    limits : array, shape (n, 2)
        Least and largest current of each circuit, in A.
    start : array, shape (N, n), or None
        Where to look alone, as far as a way leads downhill from there.
    """
    if start is not None:
        return _descended(model, distance, force, bias, limits, np.clip(start, *limits.T), NEAR)
    nearest = _descended(model, distance, force, bias, limits, np.tile(bias, (len(distance), 1)))
    corners = np.stack(np.meshgrid(*limits), axis=-1).reshape(-1, len(limits))
    # Of the domain, for in the middle of a symmetric bearing every corner pulls with nothing
    balanced = BALANCED * np.maximum(np.abs(force), model.peaks[0])
    for row in np.flatnonzero(np.abs(force - model.magnetics.force(distance, nearest)) > balanced):
        starts = np.vstack([nearest[row], corners])
        distances, wanted = np.full((2, len(starts)), [distance[row : row + 1], force[row : row + 1]])
        pull = model.magnetics.at_distances(distances)
        balancing = _balanced(pull, wanted, starts, model.resistances_ohm, limits)
        ends = _descended(model, distances, wanted, bias, limits, balancing)
        short = np.maximum(np.abs(wanted - model.magnetics.force(distances, ends)), balanced[row])
        heat = np.sum(model.resistances_ohm * (ends - bias) ** 2, axis=1)
        nearest[row] = ends[np.lexsort((heat, short))[0]]
    return nearest


def _descended(
    model: ActuatorModel,
    distance: FloatArray,
    force: FloatArray,
    bias: FloatArray,
    limits: FloatArray,
    currents: FloatArray,
    converged: float = CONVERGED,
) -> FloatArray:
    """From some currents down to the nearest ones of least heat.

    The bias is projected on the force's tangent plane again and again, with circuits that are at their limits leaving
    what is missing to the others; a step after which heat and missing force are not less is halved.
    """
    ohms, tolerance = model.resistances_ohm, converged * float(np.abs(limits).max())
    pull, share = model.magnetics.at_distances(distance), np.ones(len(distance))
    pulled, slope = pull(currents)
    for _ in range(STEPS):
        missing = force - pulled
        wanted, mu = _projected(slope, missing + np.sum(slope * currents, axis=1), bias, ohms, limits)
        step = share[:, None] * (wanted - currents)
        if np.abs(step).max() <= tolerance:
            break
        tried, tried_slope = pull(currents + step)
        # Twice the multiplier 2 mu of the force: then a short enough step lowers heat and missing force together
        weight = 4.0 * np.abs(mu)
        before = np.sum(ohms * (currents - bias) ** 2, axis=1) + weight * np.abs(missing)
        after = np.sum(ohms * (currents + step - bias) ** 2, axis=1) + weight * np.abs(force - tried)
        better = after <= before
        share = np.where(better, np.minimum(2.0 * share, 1.0), 0.5 * share)
        currents = np.where(better[:, None], currents + step, currents)
        pulled, slope = np.where(better, tried, pulled), np.where(better[:, None], tried_slope, slope)
    return _balanced(pull, force, currents, ohms, limits)


def _balanced(
    pull: ForceOfCurrents, force: FloatArray, currents: FloatArray, ohms: FloatArray, limits: FloatArray
) -> FloatArray:
    """The nearest currents that give the force, by Newton's steps as long as these come nearer to it."""
    pulled, slope = pull(currents)
    for _ in range(CORRECTIONS):
        missing = force - pulled
        wanted, _ = _projected(slope, missing + np.sum(slope * currents, axis=1), currents, ohms, limits)
        tried, tried_slope = pull(wanted)
        nearer = np.abs(force - tried) < np.abs(missing)
        if not nearer.any():
            break
        currents = np.where(nearer[:, None], wanted, currents)
        pulled, slope = np.where(nearer, tried, pulled), np.where(nearer[:, None], tried_slope, slope)
    return currents


def _projected(
    slope: FloatArray, level: FloatArray, bias: FloatArray, ohms: FloatArray, limits: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The currents within their limits with slope . i = level that are nearest to the bias, and their mu.

    They are i(mu) = clip(b + mu R^-1 slope), whose slope . i grows with mu in straight pieces from the mu at which one
    circuit comes to a limit to that of the next.
    """
    along = slope / ohms
    bias = np.broadcast_to(bias, slope.shape)
    way = (limits - bias[..., None]) / np.where(along == 0.0, np.inf, along)[..., None]
    ends = np.sort(way.reshape(len(slope), -1), axis=1)
    levels = np.einsum("rk,rmk->rm", slope, np.clip(bias[:, None] + ends[..., None] * along[:, None], *limits.T))
    upper = np.clip(np.sum(levels <= level[:, None], axis=1), 1, ends.shape[1] - 1)
    rows = np.arange(len(slope))
    low, high = levels[rows, upper - 1], levels[rows, upper]
    share = np.clip((level - low) / np.where(high > low, high - low, np.inf), 0.0, 1.0)
    mu = ends[rows, upper - 1] + share * (ends[rows, upper] - ends[rows, upper - 1])
    return np.clip(bias + mu[:, None] * along, *limits.T), mu


def bias_currents(model: ActuatorModel, distance: float) -> FloatArray:
    """The middle of each current's range, or half of the largest where no current moves the force there."""
    limits = model.validity.current_limits_A
    widths, middle = np.ptp(limits, axis=1), limits.mean(axis=1)
    each = np.stack(np.meshgrid(*limits), axis=-1).reshape(-1, len(limits))
    distances = np.full(len(each) + 1, distance)
    motional = model.magnetics.motional_constant(distances, np.vstack([middle, each]))
    strength = np.abs(motional * widths).max(axis=1)
    if strength[0] >= HARDLY_MOVES * strength.max():
        return np.asarray(middle)
    return np.asarray(middle + 0.25 * widths)
