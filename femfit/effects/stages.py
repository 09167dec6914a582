"""Applies effects stage by stage: the one place that knows the order in which they act."""

from collections.abc import Iterable, Mapping
from functools import partial

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.effects.conditions import Conditions, Nominal
from femfit.effects.effect import AddedEffect
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries

_PROBE, _UNDONE, _STEPS = 1e-3, 1e-10, 20
"""Numerical: step of a difference, and change at which a setting counts as undone, in parts of the range."""


def true_setting(
    effects: Iterable[AddedEffect], distance: FloatArray, currents: FloatArray, conditions: Conditions
) -> tuple[FloatArray, FloatArray]:
    """Distance (...) and currents (..., n) that body and windings have where these were recorded."""
    for added in effects:
        setting, of = added.effect.setting, added.effect.of
        if setting is None:
            continue
        columns = list(np.moveaxis(currents, -1, 0)) or [np.zeros(currents.shape[:-1])]
        k = conditions.nominal.circuits.index(of) if of else 0
        distance, columns[k] = setting(distance, columns[k], conditions, added.parameters)
        currents = np.stack(columns, axis=-1)[..., : currents.shape[-1]]
    return distance, currents


def recorded_setting(
    effects: Iterable[AddedEffect], distance: FloatArray, currents: FloatArray, conditions: Conditions
) -> tuple[FloatArray, FloatArray]:
    """Distance and currents that are recorded where body and windings have these: :func:`true_setting` undone.

    By Newton's steps; the first is exact for zeros, scales and delays.
    """
    effects, nominal = tuple(effects), conditions.nominal
    spans = nominal.travel_m or 1.0, nominal.peak_current_A or 1.0
    read = distance, currents
    for _ in range(_STEPS):
        moved = read[0] + _PROBE * spans[0], read[1] + _PROBE * spans[1]
        seen, beyond = (true_setting(effects, *one, conditions) for one in (read, moved))
        change = [
            (true - here) * (_PROBE * span) / (there - here)
            for true, here, there, span in zip((distance, currents), seen, beyond, spans, strict=True)
        ]
        read = read[0] + change[0], read[1] + change[1]
        if all(np.abs(one).max(initial=0.0) <= _UNDONE * span for one, span in zip(change, spans, strict=True)):
            break
    return read


def changed_coenergy(inner: CoenergySeries, effects: Iterable[AddedEffect], conditions: Conditions) -> CoenergySeries:
    """The co-energy as effects change it, the first named innermost; those with states last.

    A lag shifts the current that a core sees with all that the other effects say of it: inside of them, what they take
    for the magnet's own (W' without current) would hold a part of the lag.
    """
    for added in sorted(effects, key=lambda added: added.effect.memory is not None):
        if added.effect.coenergy is not None:
            inner = partial(_changed, inner, added, conditions)
    return inner


def _changed(
    inner: CoenergySeries,
    added: AddedEffect,
    conditions: Conditions,
    distance: FloatArray,
    current: FloatArray,
    in_distance: int,
    in_current: int,
) -> TaylorSeries:
    act = added.effect.coenergy
    if act is None:
        return inner(distance, current, in_distance, in_current)
    return act(inner, distance, current, in_distance, in_current, conditions, added.parameters)


def with_further_force(
    effects: Iterable[AddedEffect],
    force: FloatArray,
    distance: FloatArray,
    current: FloatArray,
    conditions: Conditions,
) -> FloatArray:
    """The magnetic force and what acts beside it."""
    for added in effects:
        if added.effect.force is not None:
            force = force + added.effect.force(distance, current, conditions, added.parameters)
    return force


def circuit_of(
    effects: Iterable[AddedEffect],
    resistance: FloatArray,
    voltage: FloatArray,
    current: FloatArray,
    conditions: Conditions,
) -> tuple[FloatArray, FloatArray]:
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
    effects: Iterable[AddedEffect], distance: FloatArray, current: FloatArray, conditions: Conditions
) -> tuple[FloatArray, FloatArray]:
    """Distance and current that a Hall reading belongs to: of earlier, where it is late."""
    for added in effects:
        if added.effect.hall_point is not None:
            distance, current = added.effect.hall_point(distance, current, conditions, added.parameters)
    return distance, current


def hall_field(
    series: TaylorSeries,
    coenergy: CoenergySeries,
    effects: tuple[AddedEffect, ...],
    distance: FloatArray,
    current: FloatArray,
    conditions: Conditions,
) -> FloatArray:
    """Field in T that a Hall reading shows: the series' at these points, or that of earlier ones where it is late."""
    if any(added.effect.hall_point for added in effects):
        distance, current = hall_point(effects, distance, current, conditions)
        series = changed_coenergy(coenergy, effects, conditions)(distance, current, 0, 0)
    return series.derivative(0, 0, 1)


def recorded(
    effects: Iterable[AddedEffect],
    readings: Mapping[str, FloatArray],
    distance: FloatArray,
    current: FloatArray,
    conditions: Conditions,
) -> dict[str, FloatArray]:
    """What the sensors record of true readings."""
    for added in effects:
        if added.effect.readings is not None:
            readings = added.effect.readings(readings, distance, current, conditions, added.parameters)
    return dict(readings)
