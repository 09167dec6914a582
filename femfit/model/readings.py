"""What a bench would read of an actuator model: the one prediction of compare, diagnose, add and suggest."""

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import flux_columns, resistance_column, voltage_columns
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import CHANNELS, AddedEffect
from femfit.effects.stages import hall_point, recorded, true_setting, with_further_force
from femfit.model.actuator_model import ActuatorModel
from femfit.model.at_rest import AtRest, at_rest
from femfit.model.impedance import following_share, impedances_by_column, induced_impedance, with_further_impedance
from femfit.model.magnetics import only_current
from femfit.model.with_effects import eddy_with_sources, resistance_of

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
    base = model.without_effects
    added = tuple(model.effects if effects is None else effects)
    d, i = np.asarray(distance, dtype=np.float64), base.validity.with_axis(np.asarray(current, dtype=np.float64))
    d, i = true_setting(added, d, i, conditions)
    bridge = base.has_winding and any(name.startswith(("inductance", "resistance")) for name in channels)
    seen = at_rest(base, d, i, added, conditions, slopes=bridge)
    first = only_current(i[:, :1])
    values = {"force_N": with_further_force(added, seen.force.copy(), d, first, conditions)}
    values |= dict(zip(flux_columns(base.current_names), seen.flux_linkage.T.copy(), strict=True))
    if base.sensor is not None:
        field = hall_seen(base, seen, d, i, added, conditions)
        values["hall_V"] = base.sensor.quiescent_V + base.sensor.sensitivity_V_per_T * field
    # What the driver does to a commanded voltage does not show: a bench reads across the winding
    ohms = [resistance_of(circuit, added, i[:, k], conditions) for k, circuit in enumerate(base.circuits)]
    values |= {name: ohms[k] * i[:, k] for k, name in enumerate(voltage_columns(base.circuit_names))}
    if bridge:
        known = np.stack(ohms, axis=1) if ohms else np.full(i.shape, np.nan)
        shown = _impedances(base, d, i, conditions, added, seen.inductance, known)
        values |= {name: shown[name] for name in shown if ohms or not name.startswith("resistance")}
    return recorded(added, values, d, first, conditions)


def hall_seen(
    base: ActuatorModel,
    seen: AtRest,
    distance: FloatArray,
    currents: FloatArray,
    effects: Sequence[AddedEffect],
    conditions: Conditions,
) -> FloatArray:
    """Field in T that a Hall reading shows: that of these points, or of earlier ones where it is late."""
    if not any(added.effect.hall_point for added in effects):
        return seen.hall_T
    then_d, then_i = hall_point(effects, distance, currents[:, 0], conditions)
    then = np.concatenate([then_i[:, None], currents[:, 1:]], axis=1)
    return at_rest(base, then_d, then, effects, conditions, slopes=False).hall_T


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
    share, eddy = following_share(added, f), eddy_with_sources(base, added)
    z = with_further_impedance(induced_impedance(low, f, share, eddy, d), added, d, currents[:, 0], f, conditions)
    w, series = 2.0 * np.pi * f, [one.inductance_H for one in base.circuits] or [0.0]
    z, shown = z + np.eye(low.shape[-1]) * (ohms + 1j * w[:, None] * series)[:, None, :], {}
    for name, one in impedances_by_column(z, base.circuit_names).items():
        shown[resistance_column(name)] = one.real
        shown[name] = one.imag / w
    return shown
