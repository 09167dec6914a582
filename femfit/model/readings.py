"""What a bench would read of an actuator model: the one prediction of compare, diagnose, add and suggest."""

from collections.abc import Collection, Iterable, Sequence
from functools import partial

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import flux_columns, resistance_column, voltage_columns
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import CHANNELS, AddedEffect
from femfit.effects.stages import (
    changed_coenergy,
    hall_field,
    recorded,
    true_setting,
    with_further_force,
)
from femfit.effects.taylor_series import CoenergySeries
from femfit.model.actuator_model import ActuatorModel
from femfit.model.impedance import following_share, impedances_by_column, induced_impedance, with_further_impedance
from femfit.model.magnetics import only_current
from femfit.model.sensed_effects import hall_with_effects
from femfit.model.with_effects import base_coenergy, eddy_with_sources, resistance_of, with_sources

LOW_HZ = 1e-6
"""Numerical: of an impedance at no frequency; its eddy currents have died out, and a winding that is shorted carries
no current."""


def predict_readings(
    model: ActuatorModel,
    distance: FloatArray,
    current: FloatArray,
    conditions: Conditions,
    effects: Iterable[AddedEffect] | None = None,
    channels: Collection[str] = CHANNELS,
    coenergy: CoenergySeries | None = None,
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
    coenergy : callable or None
        The base model's, from a caller who keeps what it gave.

    Returns
    -------
    dict of str to array, each of shape (n,)
        Channels that the model can predict: hall_V only with a sensor, voltage_V only with a circuit.
    """
    base = model.without_effects
    added = tuple(model.effects if effects is None else effects)
    d, i = np.asarray(distance, dtype=np.float64), base.validity.with_axis(np.asarray(current, dtype=np.float64))
    d, i = true_setting(added, d, i, conditions)
    bridge = base.has_winding and any(name.startswith(("inductance", "resistance")) for name in channels)
    seen = (
        _seen_of_circuits if conditions.nominal.circuits else partial(_seen_of_series, coenergy or base_coenergy(base))
    )
    force, flux, field, low = seen(base, d, i, added, conditions, bridge)
    first = only_current(i[:, :1])
    values = {"force_N": with_further_force(added, force, d, first, conditions)}
    values |= dict(zip(flux_columns(base.current_names), flux.T, strict=True))
    if base.sensor is not None:
        values["hall_V"] = base.sensor.quiescent_V + base.sensor.sensitivity_V_per_T * field
    # What the driver does to a commanded voltage does not show: a bench reads across the winding
    ohms = [resistance_of(circuit, added, i[:, k], conditions) for k, circuit in enumerate(base.circuits)]
    values |= {name: ohms[k] * i[:, k] for k, name in enumerate(voltage_columns(base.circuit_names))}
    if bridge:
        known = np.stack(ohms, axis=1) if ohms else np.full(i.shape, np.nan)
        shown = _impedances(base, d, i, conditions, added, low, known)
        values |= {name: shown[name] for name in shown if ohms or not name.startswith("resistance")}
    return recorded(added, values, d, first, conditions)


Seen = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Force (rows,) in N, flux linkages (rows, n) in Wb, field at the Hall element in T, inductances (rows, n, n) in H."""


def _seen_of_series(
    coenergy: CoenergySeries,
    base: ActuatorModel,
    d: FloatArray,
    i: FloatArray,
    added: tuple[AddedEffect, ...],
    conditions: Conditions,
    bridge: bool,
) -> Seen:
    """What there is of one current, or none; the inductance is worked out for a bridge alone."""
    current, n = only_current(i), i.shape[1]
    series = changed_coenergy(coenergy, added, conditions)(d, current, 1, 2 if bridge else 1)
    field = np.zeros_like(d) if base.sensor is None else hall_field(series, coenergy, added, d, current, conditions)
    low = series.derivative(0, 2)[:, None, None] if bridge else np.zeros((len(d), n, n))
    return -series.derivative(1, 0), series.derivative(0, 1)[:, None][:, :n], field, low


def _seen_of_circuits(
    base: ActuatorModel,
    d: FloatArray,
    i: FloatArray,
    added: tuple[AddedEffect, ...],
    conditions: Conditions,  # noqa: ARG001  as of one current
    bridge: bool,  # noqa: ARG001
) -> Seen:
    """The same of several."""
    magnetics, sensor = with_sources(base, added), hall_with_effects(base.sensor, added, base.current_names)
    state = magnetics.state(d, i)
    field = np.zeros_like(d) if sensor is None else sensor.field.field(d, i)
    return state.force, magnetics.flux_linkage(d, i), field, state.inductance


def _impedances(
    base: ActuatorModel,
    d: FloatArray,
    currents: FloatArray,
    conditions: Conditions,
    added: Sequence[AddedEffect],
    low: FloatArray,
    ohms: FloatArray,
) -> dict[str, FloatArray]:
    """Resistances and inductances in series of n circuits, of low inductances (rows, n, n) and ohms (rows, n)."""
    f = np.fmax(like(conditions.frequency_Hz, d), LOW_HZ)
    share, eddy = following_share(added, f, conditions), eddy_with_sources(base, added)
    z = with_further_impedance(induced_impedance(low, f, share, eddy, d), added, d, currents[:, 0], f, conditions)
    w, series = 2.0 * np.pi * f, [one.inductance_H for one in base.circuits] or [0.0]
    z, shown = z + np.eye(low.shape[-1]) * (ohms + 1j * w[:, None] * series)[:, None, :], {}
    for name, one in impedances_by_column(z, base.circuit_names).items():
        shown[resistance_column(name)] = one.real
        shown[name] = one.imag / w
    return shown
