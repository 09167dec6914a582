"""Applies effects stage by stage: the one place that knows the order in which they act."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import Expression, of_variable
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect, Coenergy, CoenergyChange, EffectPoint

Place = tuple[Expression, Expression, Conditions]
"""Distance, current of the first circuit, and conditions."""

_STEPS = 6
"""Numerical: with them a characteristic that is bent by a fifth is undone to rounding."""


def true_setting(
    effects: Iterable[AddedEffect], distance: Expression, currents: Expression, conditions: Conditions
) -> tuple[Any, Any]:
    """Distance (...) and currents (..., n) that body and windings have where these were recorded.

    Of arrays, or of expressions with currents (n,).
    """
    return _at_another(effects, "setting", distance, currents, conditions)


def hall_point(
    effects: Iterable[AddedEffect], distance: Expression, currents: Expression, conditions: Conditions
) -> tuple[Any, Any]:
    """Distance and currents that a Hall reading belongs to, of earlier where it is late: as of :func:`true_setting`."""
    return _at_another(effects, "hall_point", distance, currents, conditions)


def _at_another(
    effects: Iterable[AddedEffect], stage: str, distance: Expression, currents: Expression, conditions: Conditions
) -> tuple[Any, Any]:
    """Distance and currents that a stage has in place of these; of the first current where it is of no circuit."""
    for setting, added in _acting(effects, stage):
        of = added.effect.of
        symbolic = isinstance(currents, SX)
        columns = ca.vertsplit(currents) if symbolic else list(np.moveaxis(currents, -1, 0))
        n = len(columns)
        columns = columns or [0.0 * distance]
        k = conditions.nominal.circuits.index(of) if of else 0
        distance, columns[k] = setting(EffectPoint(distance, columns[k], conditions, added.parameters))
        currents = ca.vertcat(SX(0, 1), *columns[:n]) if symbolic else np.stack(columns, axis=-1)[..., :n]
    return distance, currents


def recorded_setting(
    effects: Iterable[AddedEffect], distance: SX, currents: SX, conditions: Conditions
) -> tuple[SX, SX]:
    """Distance and currents (n,) that are recorded where body and windings have these: :func:`true_setting` undone.

    By Newton's steps, for each by itself; the first is exact for zeros, scales and delays.
    """
    effects = tuple(added for _, added in _acting(effects, "setting"))
    if not effects:
        return distance, currents
    recorded = ca.vertcat(distance, currents)

    def nearer(x: SX) -> SX:
        true = ca.vertcat(*true_setting(effects, x[0], ca.vertcat(SX(0, 1), *ca.vertsplit(x)[1:]), conditions))
        slopes = ca.diag(ca.jacobian(true, x))
        return x + (recorded - true) / slopes

    read = recorded
    for _ in range(_STEPS):
        read = of_variable(nearer, read)
    return read[0], ca.vertcat(SX(0, 1), *ca.vertsplit(read)[1:])


def changed_coenergy(inner: Coenergy, effects: Iterable[AddedEffect], conditions: Conditions) -> Coenergy:
    """The co-energy as effects change it, the first named innermost; those with states last.

    A lag shifts the current that a core sees with all that the other effects say of it: inside of them, what they take
    for the magnet's own (W' without current) would hold a part of the lag.
    """
    for act, added in _acting(sorted(effects, key=lambda added: added.effect.memory is not None), "coenergy"):
        inner = partial(_changed, inner, act, added, conditions)
    return inner


def _changed(
    inner: Coenergy, act: CoenergyChange, added: AddedEffect, conditions: Conditions, d: Any, i: Any, h: Any
) -> Expression:
    """W'(d, i, h) at these under one effect more."""
    if not added.effect.of:
        return act(inner, EffectPoint(d, i, conditions, added.parameters, h))
    k = conditions.nominal.circuits.index(added.effect.of)  # an effect of one circuit knows that one's current alone
    before, middle, after = ca.vertsplit(i, [0, k, k + 1, i.numel()])
    point = EffectPoint(d, middle, conditions, added.parameters, h)
    return act(lambda d, i, h: inner(d, ca.vertcat(before, i, after), h), point)


def with_further_force(effects: Iterable[AddedEffect], force: Expression, *place: *Place) -> Expression:
    """The magnetic force and what acts beside it at a place."""
    for act, added in _acting(effects, "force"):
        force = force + act(EffectPoint(*place, added.parameters))
    return force


def circuit_of(
    effects: Iterable[AddedEffect], ohms: Expression, voltage: Expression, current: Expression, conditions: Conditions
) -> tuple[Expression, Expression]:
    """Resistance of the winding, and voltage that the driver applies where this one was commanded."""
    for act, added in _acting(effects, "circuit"):
        ohms, voltage = act(ohms, voltage, EffectPoint(0.0 * current, current, conditions, added.parameters))
    return ohms, voltage


def recorded(effects: Iterable[AddedEffect], values: Mapping[str, Any], *place: *Place) -> dict[str, Any]:
    """What sensors record of true readings, by channel, at a place."""
    for act, added in _acting(effects, "readings"):
        values = act(values, EffectPoint(*place, added.parameters))
    return dict(values)


def changed_by(effects: Iterable[AddedEffect], stage: str, value: Any, *arguments: Any) -> Any:
    """What effects make of ``mass`` in kg, ``ends`` (near, far) in m with the nominal facts, or ``eddy``, a factor."""
    for act, added in _acting(effects, stage):
        value = act(value, *arguments, added.parameters)
    return value


def _acting(effects: Iterable[AddedEffect], stage: str) -> Iterator[tuple[Callable[..., Any], AddedEffect]]:
    """The functions that effects give for a stage."""
    for added in effects:
        if (act := getattr(added.effect, stage)) is not None:
            yield act, added
