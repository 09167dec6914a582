"""What a bench would read of an actuator model: the one prediction of compare, diagnose, add and suggest."""

from collections.abc import Collection, Iterable

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.sweep_columns import flux_columns, voltage_columns
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
from femfit.model.impedance import following_share, induced_impedance
from femfit.model.with_effects import base_coenergy, eddy_with_sources, resistance_of, with_sources


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
        at the frequency of the conditions; where that is NaN it is low.
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
        return _read_of_circuits(model, distance, current, conditions, added)
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
        w, low = 2.0 * np.pi * np.nan_to_num(like(conditions.frequency_Hz, i)), series.derivative(0, 2)
        share, eddy = following_share(added, w / (2.0 * np.pi), conditions), eddy_with_sources(base, added)
        induced = induced_impedance(low[:, None, None], w / (2.0 * np.pi), share, eddy, d)[:, 0, 0]
        for one in added:
            if one.effect.impedance is not None:
                induced = induced + one.effect.impedance(d, i, w / (2.0 * np.pi), conditions, one.parameters)
        seen = np.where(w > 0.0, induced.imag / np.where(w > 0.0, w, 1.0), low)
        in_series = base.circuit.inductance_H if base.circuit else 0.0
        shown = {"inductance_H": in_series + seen, "resistance_ohm": ohms + induced.real}
        values |= {name: shown[name] for name in bridge}
    return recorded(added, values, d, i, conditions)


def _read_of_circuits(
    model: ActuatorModel,
    distance: FloatArray,
    currents: FloatArray,
    conditions: Conditions,
    effects: Iterable[AddedEffect],
) -> dict[str, FloatArray]:
    """Readings of a body held at rest; currents of shape (rows, n), arguments else as of ``predict_readings``."""
    base, added = model.without_effects, tuple(effects)
    names = base.magnetics.names  # type: ignore[attr-defined]
    d, i = np.asarray(distance, dtype=np.float64), np.asarray(currents, dtype=np.float64)
    d, i = true_setting(added, d, i, conditions)
    magnetics = with_sources(base, added)
    values = {"force_N": magnetics.force(d, i)}
    values |= dict(zip(flux_columns(names), magnetics.flux_linkage(d, i).T, strict=True))
    for k, (circuit, column) in enumerate(zip(base.circuits, voltage_columns(base.circuit_names), strict=True)):
        values[column] = resistance_of(circuit, added, i[:, k], conditions) * i[:, k]
    return recorded(added, values, d, i[:, 0], conditions)
