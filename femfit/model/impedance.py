"""Impedance of a body held at rest, for a small sinusoidal current about a bias: Z = R + j w L_s + induced(h(w) L).

L is d(flux linkage)/di of the model's co-energy. h(w) is what lagging states leave of it, 1 - sum_k c_k x_k(w): the
core sees the current i - sum_k c_k z_k, and z_k follows a current of one ampere with the amplitude x_k(w). Without eddy
currents the induced part is j w h L.
"""

from collections.abc import Iterable

import numpy as np

from femfit.core.arrays import ComplexArray, FloatArray
from femfit.core.errors import DomainError
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.model.eddy_currents import EddyCurrents


def following_share(effects: Iterable[AddedEffect], frequency: FloatArray, conditions: Conditions) -> ComplexArray:
    """h(w) at frequencies in Hz: how much of the flux linkage follows a small current, and how late."""
    share = np.ones(np.shape(frequency), dtype=np.complex128)
    for added in effects:
        memory, p = added.memory, added.parameters
        if memory is not None and memory.response is not None and memory.lag is not None:
            turns = memory.lag(conditions, p)
            for name, state in memory.response(frequency, conditions, p).items():
                share = share - turns[name][0] * state
    return share


def induced_impedance(
    inductance: FloatArray,
    frequency: FloatArray,
    share: ComplexArray,
    eddy: EddyCurrents | None,
    distance: FloatArray,
) -> ComplexArray:
    """Voltages in V that flux induces in n circuits, for each ampere: Z without resistances and what is in series.

    Eddy currents, as patterns (C, Q, R_e), have s C^T L + (R_e + s (C^T L C + Q)) e = 0 for each ampere. With s = j w
    and L_e = L C that leaves s L - s^2 L_e (R_e + s (C^T L_e + Q))^-1 L_e^T.

    Parameters
    ----------
    inductance : array, shape (..., n, n)
        In H, without what lags.
    share : array
        How much of it follows, as of :func:`following_share`.
    """
    s = (2j * np.pi * frequency)[..., None, None]
    following = share[..., None, None] * inductance
    result = s * following
    if eddy is None:
        return np.asarray(result)
    (at,) = eddy.forms(distance)
    mutual = following @ at.coupling
    own = np.diag(eddy.resistances_ohm) + s * (np.swapaxes(at.coupling, -1, -2) @ mutual + at.inductance)
    back = np.swapaxes(mutual, -1, -2)
    shape = np.broadcast_shapes(own.shape[:-2], back.shape[:-2])
    solved = np.linalg.solve(
        np.broadcast_to(own, (*shape, *own.shape[-2:])), np.broadcast_to(back, (*shape, *back.shape[-2:]))
    )
    return np.asarray(result - s**2 * (mutual @ solved))


def checked_frequency(frequency: FloatArray, points: tuple[int, ...]) -> FloatArray:
    """Refuse frequencies that are negative or no numbers, or that do not broadcast with points of a shape."""
    if not (np.isfinite(frequency) & (frequency >= 0.0)).all():
        raise DomainError("Frequencies must be numbers >= 0, in Hz. Leave out what is no frequency.")
    try:
        np.broadcast_shapes(frequency.shape, points)
    except ValueError as error:
        raise DomainError(
            f"Frequencies must broadcast with distance and current; instead received the shapes {frequency.shape} and "
            f"{points}. For a grid, give distance[:, None] and frequency."
        ) from error
    return frequency
