"""A model under effects at rest, by points: of readings whose conditions differ, and by its effects' parameters.

What is asked is one expression of the recorded setting, of the conditions and of the parameters, so that one function
serves all values of them.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import Expression, GraphFunction, building, of_variable, once, slope
from femfit.core.numerics import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.effects.stages import changed_coenergy
from femfit.model.magnetics import AXES, MagneticState, derivatives_of
from femfit.model.with_effects import coenergy_of

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel

SETS = 128
"""Numerical: sets of effects whose functions a model keeps."""


@dataclass(frozen=True, eq=False)
class Point:
    """Where a model under effects is asked: N points of arrays, or the symbols that an expression at one is written in.

    Distances have the shape (N,), currents (N, n); those of an expression are one, and (n,).
    """

    model: "ActuatorModel"  # Its base counts
    distance: Expression
    currents: Expression
    conditions: Conditions
    effects: Sequence[AddedEffect]  # In place of the model's own

    def parameters(self, names: Sequence[tuple[int, str]]) -> SX:
        """Some parameters, each by the number of its effect and its name."""
        return ca.vertcat(SX(0, 1), *(self.effects[k].parameters[name] for k, name in names))

    def resting(self, distance: Expression, currents: Expression) -> "Point":
        """The point at another setting, with the states that it lacks as on a slow sweep."""
        states = dict(self.conditions.memory)
        first = currents[0] if currents.numel() else SX(0.0)
        for added in self.effects:
            memory = added.effect.memory
            if added.effect.coenergy is not None and memory is not None and not set(memory.names) & set(states):
                states |= memory.steady_state(distance, first, self.conditions, added.parameters)
        return replace(self, distance=distance, currents=currents, conditions=replace(self.conditions, memory=states))

    def magnetic(self, *, slopes: bool) -> dict[str, SX]:
        """Force, flux linkages and field at the Hall element; on demand motional constants, and inductances (n n,)."""
        coenergy = changed_coenergy(coenergy_of(self.model), self.effects, self.conditions)
        names = "force", "flux_linkage", *(("motional_constant", "inductance") if slopes else ())

        def derived(x: SX) -> SX:
            d, i = x[0], ca.vertcat(SX(0, 1), *ca.vertsplit(x)[1:])
            parts = derivatives_of(names, SX(coenergy(d, i, 0.0)), d, i)
            return ca.vertcat(*parts.values(), ca.densify(slope(lambda h: coenergy(d, i, h), 0.0)))

        found = of_variable(derived, ca.vertcat(self.distance, self.currents))
        ends = accumulate((self.currents.numel() ** AXES[name] for name in names), initial=0)
        return dict(zip((*names, "hall_T"), ca.vertsplit(found, [*ends, found.numel()]), strict=True))


def at_points(what: Hashable, expressions: Callable[[Point], Mapping[str, SX]], at: Point) -> dict[str, FloatArray]:
    """Expressions (entries,) by name at N points, each of shape (entries, N).

    Parameters
    ----------
    what : hashable
        What tells the expressions from others of the same model.
    """
    known: dict[Any, Any] = once(at.model.without_effects, at_points, dict)
    numbers = at.conditions.numbers
    key = what, tuple(id(added.effect) for added in at.effects), tuple(numbers), at.conditions.running
    entry = known.get(key)
    if entry is None:  # beside the effects themselves, so that their addresses stay theirs
        entry = tuple(at.effects), *_function(expressions, at)
        while len(known) >= SETS:
            known.pop(next(iter(known)), None)
        known[key] = entry
    given = np.empty((len(numbers), len(at.distance)))
    for row, value in zip(given, numbers.values(), strict=True):
        row[:] = value
    sizes = [added.parameters[p.name] for added in at.effects for p in added.effect.parameters]
    _, names, ends, function = entry
    values = function(np.concatenate([at.distance[None], at.currents.T]), given, np.array(sizes, dtype=np.float64))
    return dict(zip(names, np.split(values, ends), strict=True))


def _function(
    expressions: Callable[[Point], Mapping[str, SX]], at: Point
) -> tuple[list[str], list[int], GraphFunction]:
    """Names of the expressions, where each but the last ends, and ((d, currents), conditions, parameters) -> all."""
    with building():
        d, i, numbers = SX.sym("d"), SX.sym("i", at.currents.shape[1]), at.conditions.numbers
        given, sizes = SX.sym("given", len(numbers)), SX(0, 1)
        symbols = []
        for added in at.effects:
            own = SX.sym(added.effect.name, len(added.effect.parameters))
            named = zip((p.name for p in added.effect.parameters), ca.vertsplit(own), strict=True)
            symbols.append(replace(added, parameters=dict(named)))
            sizes = ca.vertcat(sizes, own)
        conditions = at.conditions.with_numbers(dict(zip(numbers, ca.vertsplit(given), strict=True)))
        found = expressions(Point(at.model.without_effects, d, i, conditions, tuple(symbols)))
        ends = list(accumulate(value.numel() for value in found.values()))[:-1]
        output = ca.vertcat(*(ca.densify(ca.vec(value)) for value in found.values()))
        return list(found), ends, GraphFunction([ca.vertcat(d, i), given, sizes], output)


def at_rest(at: Point) -> MagneticState:
    """What effects make of a model at N points, without dF/dd; states that conditions lack are as on a slow sweep."""

    def magnetic(point: Point) -> dict[str, SX]:
        return point.resting(point.distance, point.currents).magnetic(slopes=True)

    acting, points = tuple(added for added in at.effects if added.effect.coenergy is not None), at.currents.shape
    values = at_points("at rest", magnetic, replace(at, effects=acting))
    shapes = {name: (points[0], *points[1:] * AXES.get(name, 0)) for name in values}
    return MagneticState(**{name: part.T.reshape(shapes[name]) for name, part in values.items()})
