"""What a bench would read of an actuator model: the one prediction of compare, diagnose, add and suggest.

What is asked of a model under effects at rest is one expression of the recorded setting, of the conditions and of the
effects' parameters, so that one function serves all values of them; values, slopes by the parameters and slopes by the
setting are derived from it.
"""

from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import TYPE_CHECKING, Any, cast

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import Expression, GraphFunction, building, of_variable, once, slope
from femfit.core.numerics import ComplexArray, FloatArray
from femfit.core.sweep_columns import flux_columns, resistance_column, voltage_columns
from femfit.effects.conditions import Conditions
from femfit.effects.effect import CHANNELS, AddedEffect
from femfit.effects.stages import changed_coenergy, hall_point, recorded, true_setting, with_further_force
from femfit.model.decay import Complex
from femfit.model.impedance import impedance_expression, impedances_by_column
from femfit.model.magnetics import AXES, MagneticState, derivatives_of
from femfit.model.with_effects import coenergy_of, resistance_of

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel

LOW_HZ = 1e-6
"""Numerical: of an impedance at no frequency; its eddy currents have died out, and a winding that is shorted carries
no current."""

Parameter = tuple[int, str]
"""Of a sequence of effects: the number of one, and a name among its parameters."""

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

        derivatives = of_variable(derived, ca.vertcat(self.distance, self.currents))
        ends = accumulate((self.currents.numel() ** AXES[name] for name in names), initial=0)
        return dict(zip((*names, "hall_T"), ca.vertsplit(derivatives, [*ends, derivatives.numel()]), strict=True))


def at_points(what: Hashable, expressions: Callable[[Point], Mapping[str, SX]], points: Point) -> dict[str, FloatArray]:
    """Expressions (entries,) by name at N points, each of shape (entries, N).

    Parameters
    ----------
    what : hashable
        What tells the expressions from others of the same model.
    """
    functions: dict[Any, Any] = once(points.model.without_effects, at_points, dict)
    numbers = points.conditions.numbers
    key = what, tuple(id(added.effect) for added in points.effects), tuple(numbers), points.conditions.running
    entry = functions.get(key)
    if entry is None:  # beside the effects themselves, so that their addresses stay theirs
        entry = tuple(points.effects), *_function(expressions, points)
        while len(functions) >= SETS:
            functions.pop(next(iter(functions)), None)
        functions[key] = entry
    _, names, ends, function = entry
    settings = np.empty((len(numbers), len(points.distance)))
    for row, value in zip(settings, numbers.values(), strict=True):
        row[:] = value
    sizes = np.array(
        [added.parameters[p.name] for added in points.effects for p in added.effect.parameters], dtype=float
    )
    values = function(np.concatenate([points.distance[None], points.currents.T]), settings, sizes)
    return dict(zip(names, np.split(values, ends), strict=True))


def _function(
    expressions: Callable[[Point], Mapping[str, SX]], points: Point
) -> tuple[list[str], list[int], GraphFunction]:
    """Names of the expressions, where each but the last ends, and ((d, currents), conditions, parameters) -> all."""
    with building():
        d, i, numbers = SX.sym("d"), SX.sym("i", points.currents.shape[1]), points.conditions.numbers
        conditions_symbol, symbols, sizes = SX.sym("given", len(numbers)), [], []
        for added in points.effects:
            sizes.append(SX.sym(added.effect.name, len(added.effect.parameters)))
            named = zip((p.name for p in added.effect.parameters), ca.vertsplit(sizes[-1]), strict=True)
            symbols.append(replace(added, parameters=dict(named)))
        conditions = points.conditions.with_numbers(dict(zip(numbers, ca.vertsplit(conditions_symbol), strict=True)))
        point = Point(points.model.without_effects, d, i, conditions, tuple(symbols))
        named_values = {name: ca.densify(ca.vec(value)) for name, value in expressions(point).items()}
        ends = list(accumulate(value.numel() for value in named_values.values()))[:-1]
        inputs = [ca.vertcat(d, i), conditions_symbol, ca.vertcat(SX(0, 1), *sizes)]
        return list(named_values), ends, GraphFunction(inputs, ca.vertcat(*named_values.values()))


def at_rest(points: Point) -> MagneticState:
    """What effects make of a model at N points, without dF/dd; states that conditions lack are as on a slow sweep."""

    def magnetic(point: Point) -> dict[str, SX]:
        return point.resting(point.distance, point.currents).magnetic(slopes=True)

    acting, shape = tuple(added for added in points.effects if added.effect.coenergy is not None), points.currents.shape
    values = at_points("at rest", magnetic, replace(points, effects=acting))
    shapes = {name: (shape[0], *shape[1:] * AXES.get(name, 0)) for name in values}
    return MagneticState(**{name: rows.T.reshape(shapes[name]) for name, rows in values.items()})


def predict_readings(
    model: "ActuatorModel",
    distance: FloatArray,
    current: FloatArray,
    conditions: Conditions,
    effects: Iterable[AddedEffect] | None = None,
    channels: Collection[str] = CHANNELS,
) -> dict[str, FloatArray]:
    """Readings of a body held at rest.

    force_N is the force on the body towards the electromagnet, flux_linkage_Wb that of the winding, hall_V the Hall
    element's output before clipping and rounding, voltage_V the voltage across the winding (R i on a static bench).

    Parameters
    ----------
    model : ActuatorModel
        Its base and its effects count; it is evaluated outside of its validity domain as well.
    distance, current : array, shape (n,)
        As recorded, in m and A; currents of several circuits have the shape (n, circuits), and channels their names.
    channels : collection of str
        What is wanted beside the usual channels: inductance_H and resistance_ohm, in series, as an LCR meter reads them
        at the frequency of the conditions; where that is NaN it is low. Of several circuits as of
        :func:`femfit.model.impedance.impedances_by_column`.

    Returns
    -------
    dict of str to array, each of shape (n,)
        Channels that the model can predict: hall_V only with a sensor, voltage_V only with a circuit.
    """
    added = tuple(model.effects if effects is None else effects)
    readings = readings_by(Point(model, distance, current, conditions, added), (), channels)
    return {name: values[0] for name, values in readings.items()}


def readings_by(
    points: Point, parameters: Sequence[Parameter], channels: Collection[str] = CHANNELS
) -> dict[str, FloatArray]:
    """Readings as of :func:`predict_readings`, then their slopes by parameters of effects; each (1 + parameters, n)."""
    wanted = tuple(parameters)

    def derived(point: Point, values: SX) -> SX:
        amplitudes = ca.vertcat(SX(0, 1), *(point.effects[k].parameters[name] for k, name in wanted))
        return ca.horzcat(values, ca.jacobian(values, amplitudes))

    return _at_rows(("readings", wanted), derived, channels, points)


def setting_slopes(points: Point, channels: Collection[str] = CHANNELS) -> dict[str, FloatArray]:
    """First and second derivatives of readings by the recorded distance, then first ones by each current.

    Of each channel that the model predicts with the effects, of shape (2 + circuits, n).
    """

    def derived(point: Point, values: SX) -> SX:
        slope = ca.jacobian(values, point.distance)
        return ca.horzcat(slope, ca.jacobian(slope, point.distance), ca.jacobian(values, point.currents))

    return _at_rows(("setting",), derived, channels, points)


def _at_rows(
    what: tuple[Hashable, ...], derive: Callable[[Point, SX], SX], channels: Collection[str], points: Point
) -> dict[str, FloatArray]:
    """What is derived of the readings, a row a channel, impedances among them where these are wanted."""
    base = points.model.without_effects
    bridge = base.has_winding and any(name.startswith(("inductance", "resistance")) for name in channels)

    def rows(point: Point) -> dict[str, SX]:
        values = _recorded(point, bridge)
        return dict(zip(values, ca.vertsplit(derive(point, ca.vertcat(*map(SX, values.values())))), strict=True))

    d, i = (np.asarray(values, dtype=np.float64) for values in (points.distance, points.currents))
    conditions = replace(points.conditions, frequency_Hz=np.fmax(points.conditions.frequency_Hz, LOW_HZ))
    points = replace(points, distance=d, currents=base.validity.with_axis(i), conditions=conditions)
    return at_points((*what, bridge), rows, points)


def _recorded(point: Point, bridge: bool) -> dict[str, Expression]:
    """What is recorded of each channel, impedances among them where there is a bridge."""
    base, effects, conditions = point.model, point.effects, point.conditions
    d, i = true_setting(effects, point.distance, point.currents, conditions)
    state = point.resting(d, i).magnetic(slopes=bridge)
    first, hall_T = i[0] if i.numel() else SX(0.0), state["hall_T"]
    values: dict[str, Expression] = {"force_N": with_further_force(effects, state["force"], d, first, conditions)}
    values |= dict(zip(flux_columns(base.current_names), ca.vertsplit(state["flux_linkage"]), strict=True))
    if base.sensor is not None:
        if any(added.effect.hall_point for added in effects):
            hall_T = point.resting(*hall_point(effects, d, i, conditions)).magnetic(slopes=False)["hall_T"]
        values["hall_V"] = base.sensor.quiescent_V + base.sensor.sensitivity_V_per_T * hall_T
    # What the driver does to a commanded voltage does not show: a bench reads across the winding
    ohms = [resistance_of(circuit, effects, i[k], conditions) for k, circuit in enumerate(base.circuits)]
    values |= {name: ohms[k] * i[k] for k, name in enumerate(voltage_columns(base.circuit_names))}
    if bridge:
        inductance, w = ca.reshape(state["inductance"], i.numel(), i.numel()), 2.0 * np.pi * conditions.frequency_Hz
        true_point, resistances = replace(point, distance=d, currents=i), ohms or [SX(np.nan)] * i.numel()
        z = impedance_expression(true_point, inductance, Complex(SX(0.0), w), resistances)
        for name, column in impedances_by_column(z, base.circuit_names).items():
            entry = Complex.of(column)
            values |= {resistance_column(name): entry.real} if ohms else {}
            values[name] = entry.imag / w
    return recorded(effects, values, d, first, conditions)


def hall_seen(state: MagneticState, points: Point) -> FloatArray:
    """Field in T that a Hall reading shows: that of these points, or of earlier ones where it is late."""
    if not any(added.effect.hall_point for added in points.effects):
        return state.hall_T
    distance, currents = hall_point(points.effects, points.distance, points.currents, points.conditions)
    return at_rest(replace(points, distance=distance, currents=currents)).hall_T


def impedances_at(
    model: "ActuatorModel", distance: FloatArray, currents: FloatArray, frequency: FloatArray
) -> ComplexArray:
    """Impedances in ohm at distances (...), currents (..., n) and frequencies (...) in Hz, (..., n, n)."""
    n = currents.shape[-1]

    def made() -> GraphFunction:
        d, i, f = SX.sym("d"), SX.sym("i", n), SX.sym("f")
        inductance = ca.hessian(SX(model.magnetics.expression(d, i)), i)[0]
        point = Point(model.without_effects, d, i, cast("Conditions", model.conditions), model.effects)
        s, ohms = Complex(SX(0.0), 2.0 * np.pi * f), model.resistances_ohm.tolist()
        entries = impedance_expression(point, inductance, s, ohms).ravel()
        parts = [*(x.real for x in entries), *(x.imag for x in entries)]
        return GraphFunction([ca.vertcat(d, i, f)], ca.vertcat(*parts))

    points = np.broadcast_shapes(distance.shape, currents.shape[:-1], frequency.shape)
    x = [
        np.broadcast_to(coordinate, points).ravel()
        for coordinate in (distance, *np.moveaxis(currents, -1, 0), frequency)
    ]
    real, imag = np.split(once(model, "impedances", made)(np.stack(x)), 2)
    return np.asarray((real + 1j * imag).T.reshape(*points, n, n))
