"""What effects make of co-energy and Hall field at rest, by points: of readings whose conditions differ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import GraphFunction, building, slope
from femfit.core.numerics import FloatArray
from femfit.effects.conditions import Conditions, Warmth, warmth
from femfit.effects.effect import AddedEffect
from femfit.effects.stages import changed_coenergy
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import coenergy_of


@dataclass(frozen=True, eq=False)
class AtRest:
    """What a bench shows of readings at rest, N of n currents."""

    force: FloatArray  # In N, shape (N,)
    flux_linkage: FloatArray  # In Wb, shape (N, n)
    hall_T: FloatArray  # Field at the Hall element, shape (N,); 0 without one
    # In N/A and H, shapes (N, n) and (N, n, n); NaN where they were not asked for
    motional_constant: FloatArray
    inductance: FloatArray


KEPT, SETS = 2, 64
"""Numerical: results that are kept of each set of effects, and sets."""


@dataclass(frozen=True, eq=False)
class _Known:
    """A function of a set of effects, and what it gave last."""

    effects: tuple[AddedEffect, ...]
    function: GraphFunction
    values: dict[tuple[bytes, ...], FloatArray] = field(default_factory=dict)


def at_rest(
    model: ActuatorModel,
    distance: FloatArray,
    currents: FloatArray,
    effects: Sequence[AddedEffect],
    conditions: Conditions,
    *,
    slopes: bool = True,
) -> AtRest:
    """What effects in place of a model's own make of it at distances (N,) and currents (N, n).

    Where the conditions lack an effect's states, these are as on a slow sweep.

    Parameters
    ----------
    slopes : bool
        Whether motional constants and inductances are asked for.
    """
    acting = tuple(added for added in effects if added.effect.coenergy is not None)
    memory = _states(distance, currents, acting, conditions)
    known = model.without_effects.resting
    key = tuple(id(added.effect) for added in acting), tuple(memory), conditions.running, slopes
    while len(known) > SETS:
        known.pop(next(iter(known)), None)
    if key not in known:  # beside the effects themselves, so that their addresses stay theirs
        known[key] = _Known(acting, _function(model, acting, tuple(memory), conditions, slopes))
    warmths = warmth(conditions.coil_temperature_C), warmth(conditions.magnet_temperature_C)
    rows = [x for one in warmths for x in (one.kelvin, one.unknown)] + list(memory.values())
    given = np.empty((len(rows), len(distance)))
    for row, x in zip(given, rows, strict=True):
        row[:] = x
    sizes = [added.parameters[p.name] for added in acting for p in added.effect.parameters]
    inputs = np.concatenate([distance[None], currents.T]), given, np.array(sizes, dtype=np.float64)
    asked = tuple(x.tobytes() for x in inputs)
    if asked not in known[key].values:  # a fit changes one size of one effect at a time
        while len(known[key].values) >= KEPT:
            known[key].values.pop(next(iter(known[key].values)))
        known[key].values[asked] = known[key].function(*inputs)
        known[key].values[asked].setflags(write=False)
    values = known[key].values[asked]
    n, count = currents.shape[1], len(distance)
    force, flux, seen, rest = np.split(values, np.cumsum([1, n, 1]))
    if not slopes:
        rest = np.full((n + n * n, count), np.nan)
    return AtRest(force[0], flux.T, seen[0], rest[:n].T, rest[n:].T.reshape(count, n, n))


def _states(
    distance: FloatArray, currents: FloatArray, effects: Sequence[AddedEffect], conditions: Conditions
) -> dict[str, FloatArray]:
    states: dict[str, FloatArray] = {}
    for added in effects:
        memory = added.effect.memory
        if memory is not None:
            known = {name: conditions.memory[name] for name in memory.names if name in conditions.memory}
            states |= known or memory.steady_state(distance, currents[:, 0], conditions, added.parameters)
    return states


def _function(
    model: ActuatorModel, effects: Sequence[AddedEffect], states: Sequence[str], conditions: Conditions, slopes: bool
) -> GraphFunction:
    """((d, currents), (temperatures, states), parameters) -> all of :class:`AtRest`, one below the other."""
    n = len(model.without_effects.current_names)
    with building():
        d, i, given = SX.sym("d"), SX.sym("i", n), SX.sym("given", 4 + len(states))
        sizes, symbols = SX(0, 1), []
        for added in effects:
            own = SX.sym(added.effect.name, len(added.effect.parameters))
            sizes = ca.vertcat(sizes, own)
            symbols.append(replace(added, parameters=_named(added, own)))
        at = replace(
            conditions,
            coil_temperature_C=Warmth(given[0], given[1]),
            magnet_temperature_C=Warmth(given[2], given[3]),
            memory=dict(zip(states, ca.vertsplit(given[4:]), strict=True)),
        )
        changed = changed_coenergy(coenergy_of(model), symbols, at)
        coenergy, field = SX(changed(d, i, 0.0)), slope(lambda h: changed(d, i, h), 0.0)
        linkage = ca.gradient(coenergy, i)
        parts = [-ca.gradient(coenergy, d), linkage, field]
        if slopes:
            parts += [-ca.jacobian(linkage, d), ca.vec(ca.jacobian(linkage, i))]
        return GraphFunction([ca.vertcat(d, i), given, sizes], ca.vertcat(*(ca.densify(part) for part in parts)))


def _named(added: AddedEffect, sizes: SX) -> Mapping[str, SX]:
    return {p.name: sizes[k] for k, p in enumerate(added.effect.parameters)}
