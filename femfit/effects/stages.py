"""Applies effects stage by stage: the one place that knows the order in which they act."""

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import Expression, of_variable
from femfit.effects.conditions import Conditions, Nominal
from femfit.effects.effect import AddedEffect, Coenergy

_STEPS = 6
"""Numerical: with them a characteristic that is bent by a fifth is undone to rounding."""


def true_setting(
    effects: Iterable[AddedEffect], distance: Expression, currents: Expression, conditions: Conditions
) -> tuple[Any, Any]:
    """Distance (...) and currents (..., n) that body and windings have where these were recorded.

    Of arrays, or of expressions with currents (n,).
    """
    for added in effects:
        setting, of = added.effect.setting, added.effect.of
        if setting is None:
            continue
        symbolic = isinstance(currents, SX)
        columns = ca.vertsplit(currents) if symbolic else list(np.moveaxis(currents, -1, 0))
        n = len(columns)
        columns = columns or [0.0 * distance]
        k = conditions.nominal.circuits.index(of) if of else 0
        distance, columns[k] = setting(distance, columns[k], conditions, added.parameters)
        currents = ca.vertcat(SX(0, 1), *columns[:n]) if symbolic else np.stack(columns, axis=-1)[..., :n]
    return distance, currents


def recorded_setting(
    effects: Iterable[AddedEffect], distance: SX, currents: SX, conditions: Conditions
) -> tuple[SX, SX]:
    """Distance and currents (n,) that are recorded where body and windings have these: :func:`true_setting` undone.

    By Newton's steps, for each by itself; the first is exact for zeros, scales and delays.
    """
    effects = tuple(added for added in effects if added.effect.setting is not None)
    if not effects:
        return distance, currents
    known = ca.vertcat(distance, currents)

    def nearer(x: SX) -> SX:
        seen = ca.vertcat(*true_setting(effects, x[0], ca.vertcat(SX(0, 1), *ca.vertsplit(x)[1:]), conditions))
        slopes = ca.diag(ca.jacobian(seen, x))
        return x + (known - seen) / slopes

    read = known
    for _ in range(_STEPS):
        read = of_variable(nearer, read)
    return read[0], ca.vertcat(SX(0, 1), *ca.vertsplit(read)[1:])


def changed_coenergy(inner: Coenergy, effects: Iterable[AddedEffect], conditions: Conditions) -> Coenergy:
    """The co-energy as effects change it, the first named innermost; those with states last.

    A lag shifts the current that a core sees with all that the other effects say of it: inside of them, what they take
    for the magnet's own (W' without current) would hold a part of the lag.
    """
    for added in sorted(effects, key=lambda added: added.effect.memory is not None):
        if added.effect.coenergy is not None:
            inner = partial(_changed, inner, added, conditions)
    return inner


def _changed(
    inner: Coenergy, added: AddedEffect, conditions: Conditions, d: Expression, i: Expression, h: Expression
) -> Expression:
    act, of = added.effect.coenergy, added.effect.of
    if act is None:
        return inner(d, i, h)
    if not of:
        return act(inner, d, i, h, conditions, added.parameters)
    k = conditions.nominal.circuits.index(of)  # an effect of one circuit knows that circuit's current alone
    before, own, after = ca.vertsplit(i, [0, k, k + 1, i.numel()])
    return act(lambda d, i, h: inner(d, ca.vertcat(before, i, after), h), d, own, h, conditions, added.parameters)


def with_further_force(
    effects: Iterable[AddedEffect],
    force: Expression,
    distance: Expression,
    current: Expression,
    conditions: Conditions,
) -> Expression:
    """The magnetic force and what acts beside it."""
    for added in effects:
        if added.effect.force is not None:
            force = force + added.effect.force(distance, current, conditions, added.parameters)
    return force


def circuit_of(
    effects: Iterable[AddedEffect],
    resistance: Expression,
    voltage: Expression,
    current: Expression,
    conditions: Conditions,
) -> tuple[Expression, Expression]:
    """Resistance of the winding, and voltage that the driver applies where this one was commanded."""
    for added in effects:
        if added.effect.circuit is not None:
            resistance, voltage = added.effect.circuit(resistance, voltage, current, conditions, added.parameters)
    return resistance, voltage


def moving_mass(effects: Iterable[AddedEffect], mass: float) -> float:
    """The mass that really moves."""
    for added in effects:
        mass = added.effect.mass(mass, added.parameters) if added.effect.mass else mass
    return mass


def stops_of(effects: Iterable[AddedEffect], ends: tuple[float, float], nominal: Nominal) -> tuple[float, float]:
    """Where the body is really stopped."""
    for added in effects:
        ends = added.effect.ends(ends, nominal, added.parameters) if added.effect.ends else ends
    return ends


def hall_point(
    effects: Iterable[AddedEffect], distance: Expression, current: Expression, conditions: Conditions
) -> tuple[Expression, Expression]:
    """Distance and current that a Hall reading belongs to: of earlier, where it is late."""
    for added in effects:
        if added.effect.hall_point is not None:
            distance, current = added.effect.hall_point(distance, current, conditions, added.parameters)
    return distance, current


def recorded(
    effects: Iterable[AddedEffect],
    readings: Mapping[str, Expression],
    distance: Expression,
    current: Expression,
    conditions: Conditions,
) -> dict[str, Expression]:
    """What the sensors record of true readings."""
    for added in effects:
        if added.effect.readings is not None:
            readings = added.effect.readings(readings, distance, current, conditions, added.parameters)
    return dict(readings)
