"""Impedance of a body held at rest, for a small sinusoidal current about a bias: Z = R + j w (L_s + h(w) L).

L is d(flux linkage)/di of the model's co-energy. h(w) is what lagging states leave of it, 1 - sum_k c_k x_k(w): the
core sees the current i - sum_k c_k z_k, and z_k follows a current of one ampere with the amplitude x_k(w).
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.arrays import ComplexArray, FloatArray
from femfit.core.errors import DomainError
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel


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


def impedance_of(
    model: "ActuatorModel", inductance: FloatArray, frequency: FloatArray, share: ComplexArray | None = None
) -> ComplexArray:
    """R + j w (L_s + h(w) L) of a model's circuits with the inductances L, (..., n, n) of several."""
    s, several = 2j * np.pi * frequency, len(model.circuits) > 1
    share = np.ones_like(s) if share is None else share
    if several:
        s, share = s[..., None, None], share[..., None, None]
        return np.diag(model.resistances_ohm) + s * (model.series_inductances_H + share * inductance)
    return np.asarray(model.resistances_ohm[0] + s * (model.series_inductances_H[0, 0] + share * inductance))


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
