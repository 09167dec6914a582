"""What a bench would read of an actuator model: the one prediction of compare, diagnose, add and suggest.

Readings are an expression of what is recorded and of the effects' parameters; values, slopes by the parameters and
slopes by the setting are derived from it.
"""

from collections.abc import Callable, Collection, Hashable, Iterable, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import Expression
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import flux_columns, resistance_column, voltage_columns
from femfit.effects.conditions import Conditions
from femfit.effects.effect import CHANNELS, AddedEffect
from femfit.effects.stages import changed_by, hall_point, true_setting, with_further_force
from femfit.model.actuator_model import ActuatorModel
from femfit.model.at_rest import Point, at_points, at_rest
from femfit.model.decay import Complex
from femfit.model.impedance import impedance_expression, impedances_by_column
from femfit.model.magnetics import MagneticState
from femfit.model.with_effects import resistance_of

LOW_HZ = 1e-6
"""Numerical: of an impedance at no frequency; its eddy currents have died out, and a winding that is shorted carries
no current."""

Parameter = tuple[int, str]
"""Of a sequence of effects: the number of one, and a name among its parameters."""


def predict_readings(
    model: ActuatorModel,
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
    found = readings_by(Point(model, distance, current, conditions, added), (), channels)
    return {name: values[0] for name, values in found.items()}


def readings_by(
    at: Point, parameters: Sequence[Parameter], channels: Collection[str] = CHANNELS
) -> dict[str, FloatArray]:
    """Readings as of :func:`predict_readings`, then their slopes by parameters of effects; each (1 + parameters, n)."""
    wanted = tuple(parameters)

    def derived(point: Point, values: SX) -> SX:
        return ca.horzcat(values, ca.jacobian(values, point.parameters(wanted)))

    return _at_rows(("readings", wanted), derived, channels, at)


def setting_slopes(at: Point, channels: Collection[str] = CHANNELS) -> dict[str, FloatArray]:
    """First and second derivatives of readings by the recorded distance, then first ones by each current.

    Of each channel that the model predicts with the effects, of shape (2 + circuits, n).
    """

    def derived(point: Point, values: SX) -> SX:
        slope = ca.jacobian(values, point.distance)
        return ca.horzcat(slope, ca.jacobian(slope, point.distance), ca.jacobian(values, point.currents))

    return _at_rows(("setting",), derived, channels, at)


def _at_rows(
    what: tuple[Hashable, ...], derive: Callable[[Point, SX], SX], channels: Collection[str], at: Point
) -> dict[str, FloatArray]:
    """What is derived of the readings, a row a channel, impedances among them where these are wanted."""
    base = at.model.without_effects
    bridge = base.has_winding and any(name.startswith(("inductance", "resistance")) for name in channels)

    def rows(point: Point) -> dict[str, SX]:
        values = _recorded(point, bridge)
        return dict(zip(values, ca.vertsplit(derive(point, ca.vertcat(*map(SX, values.values())))), strict=True))

    d, i = (np.asarray(values, dtype=np.float64) for values in (at.distance, at.currents))
    conditions = replace(at.conditions, frequency_Hz=np.fmax(at.conditions.frequency_Hz, LOW_HZ))
    at = replace(at, distance=d, currents=base.validity.with_axis(i), conditions=conditions)
    return at_points((*what, bridge), rows, at)


def _recorded(point: Point, bridge: bool) -> dict[str, Expression]:
    """What is recorded of each channel, impedances among them where there is a bridge."""
    base, effects, conditions = point.model, point.effects, point.conditions
    d, i = true_setting(effects, point.distance, point.currents, conditions)
    seen = point.resting(d, i).magnetic(slopes=bridge)
    first, hall_T = i[0] if i.numel() else SX(0.0), seen["hall_T"]
    values: dict[str, Expression] = {"force_N": with_further_force(effects, seen["force"], d, first, conditions)}
    values |= dict(zip(flux_columns(base.current_names), ca.vertsplit(seen["flux_linkage"]), strict=True))
    if base.sensor is not None:
        if any(added.effect.hall_point for added in effects):
            hall_T = point.resting(*hall_point(effects, d, i, conditions)).magnetic(slopes=False)["hall_T"]
        values["hall_V"] = base.sensor.quiescent_V + base.sensor.sensitivity_V_per_T * hall_T
    # What the driver does to a commanded voltage does not show: a bench reads across the winding
    ohms = [resistance_of(circuit, effects, i[k], conditions) for k, circuit in enumerate(base.circuits)]
    values |= {name: ohms[k] * i[k] for k, name in enumerate(voltage_columns(base.circuit_names))}
    if bridge:
        inductance, w = ca.reshape(seen["inductance"], i.numel(), i.numel()), 2.0 * np.pi * conditions.frequency_Hz
        at, resistances = replace(point, distance=d, currents=i), ohms or [SX(np.nan)] * i.numel()
        z = impedance_expression(at, inductance, Complex(SX(0.0), w), resistances)
        for name, column in impedances_by_column(z, base.circuit_names).items():
            entry = Complex.of(column)
            values |= {resistance_column(name): entry.real} if ohms else {}
            values[name] = entry.imag / w
    return dict(changed_by(effects, "readings", values, d, first, conditions))


def hall_seen(seen: MagneticState, at: Point) -> FloatArray:
    """Field in T that a Hall reading shows: that of these points, or of earlier ones where it is late."""
    if not any(added.effect.hall_point for added in at.effects):
        return seen.hall_T
    distance, currents = hall_point(at.effects, at.distance, at.currents, at.conditions)
    return at_rest(replace(at, distance=distance, currents=currents)).hall_T
