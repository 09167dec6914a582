"""What a bench would read of an actuator model: the one prediction of compare, diagnose, add and suggest."""

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import flux_columns, resistance_column, voltage_columns
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import CHANNELS, AddedEffect
from femfit.effects.stages import (
    changed_coenergy,
    circuit_of,
    hall_field,
    recorded,
    true_setting,
    with_further_force,
)
from femfit.effects.taylor_series import CoenergySeries
from femfit.model.actuator_model import ActuatorModel
from femfit.model.impedance import following_share, impedances_by_column, induced_impedance, with_further_impedance
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
    if base.validity.further_A:
        return _read_of_circuits(model, distance, current, conditions, added, channels)
    d, i = np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64)
    d, i = true_setting(added, d, i, conditions)
    coenergy = coenergy or base_coenergy(base)
    bridge = {"inductance_H", "resistance_ohm"} & set(channels) if base.has_winding else set()
    series = changed_coenergy(coenergy, added, conditions)(d, i, 1, 2 if bridge else 1)
    force = with_further_force(added, -series.derivative(1, 0), d, i, conditions)
    values = {"force_N": force}
    if base.has_winding:
        values["flux_linkage_Wb"] = series.derivative(0, 1)
    if base.sensor is not None:
        field = hall_field(series, coenergy, added, d, i, conditions)
        values["hall_V"] = base.sensor.quiescent_V + base.sensor.sensitivity_V_per_T * field
    if base.circuit is not None:
        # What the driver does to a commanded voltage does not show: a bench reads across the winding
        ohms, _ = circuit_of(added, like(base.circuit.resistance_ohm, i), np.zeros_like(i), i, conditions)
        values["voltage_V"] = ohms * i
    else:
        ohms, bridge = np.full_like(i, np.nan), bridge - {"resistance_ohm"}
    if bridge:
        shown = _impedances(
            base, d, i[:, None], conditions, added, series.derivative(0, 2)[:, None, None], ohms[:, None]
        )
        values |= {name: shown[name] for name in bridge}
    return recorded(added, values, d, i, conditions)


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


def _read_of_circuits(
    model: ActuatorModel,
    distance: FloatArray,
    currents: FloatArray,
    conditions: Conditions,
    added: Sequence[AddedEffect],
    channels: Collection[str],
) -> dict[str, FloatArray]:
    """Readings of a body held at rest; currents of shape (rows, n), arguments else as of ``predict_readings``."""
    base = model.without_effects
    names = base.magnetics.names  # type: ignore[attr-defined]
    d, i = np.asarray(distance, dtype=np.float64), np.asarray(currents, dtype=np.float64)
    d, i = true_setting(added, d, i, conditions)
    magnetics = with_sources(base, added)
    values = {"force_N": magnetics.force(d, i)}
    values |= dict(zip(flux_columns(names), magnetics.flux_linkage(d, i).T, strict=True))
    ohms = [resistance_of(circuit, added, i[:, k], conditions) for k, circuit in enumerate(base.circuits)]
    values |= {name: ohms[k] * i[:, k] for k, name in enumerate(voltage_columns(base.circuit_names))}
    if any(name.startswith(("inductance", "resistance")) for name in channels):
        low = magnetics.state(d, i).inductance
        values |= _impedances(base, d, i, conditions, added, low, np.stack(ohms, axis=1))
    return recorded(added, values, d, i[:, 0], conditions)
