"""What a model with effects makes of a recorded motion: balances of force and voltage, and what the sensors read.

Over each window, with means <.> by its test function (:mod:`femfit.identify.series.weights`),

    force     m_0 (g - <d''>)  =  (m_0 / m) <F(d, i)> + m_0 (<d''> of the true less of the recorded d)
    voltage   <U>              =  <R i> + <d lambda/dt> + <U - U_applied>

The left sides are measured, the right sides the model's; an effect changes the right sides alone. Nothing is integrated
over time, so that an unstable plant in a closed loop is no harder than a stable one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.effects.stages import (
    changed_coenergy,
    circuit_of,
    hall_field,
    moving_mass,
    recorded,
    true_setting,
    with_further_force,
)
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries
from femfit.identify.series.memory import states_along
from femfit.identify.series.weights import Weights
from femfit.model.actuator_model import ActuatorModel
from femfit.model.actuator_model import Motion as BaseMotion

FORCE_BALANCE, VOLTAGE_BALANCE = "force_balance_N", "voltage_balance_V"

SERIES_ROWS = (FORCE_BALANCE, VOLTAGE_BALANCE, "hall_V", "force_N")
"""Channels that a time series may be compared in."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A recorded motion at n nodes.

    Parameters
    ----------
    time_s : array, shape (n,)
        On the record's clock.
    first : array of bool, shape (n,)
        Whether a new stretch begins.
    distance_m, current_A, voltage_V : array, shape (n,)
        As recorded, smoothed.
    """

    time_s: FloatArray
    first: BoolArray
    distance_m: FloatArray
    current_A: FloatArray
    voltage_V: FloatArray
    at: Conditions


@dataclass(frozen=True, eq=False)
class _Point:
    """A motion as effects make it: the true setting, the conditions, the co-energy's series, and the force."""

    distance: FloatArray
    current: FloatArray
    at: Conditions
    series: TaylorSeries
    force: FloatArray


def model_balances(
    base: ActuatorModel, coenergy: CoenergySeries, motion: Motion, weights: Weights, effects: Sequence[AddedEffect]
) -> dict[str, FloatArray]:
    """The right sides of the balances.

    Returns
    -------
    dict of str to array, each of shape (w,)
        Of force where the model has a motion, of voltage where it has a circuit.
    """
    point, result = _excited(coenergy, motion, effects), {}
    if base.motion is not None:
        share, inertia = _inertia(base.motion, motion, weights, point.distance, effects)
        result[FORCE_BALANCE] = share * (weights.mean @ point.force) + inertia
    if base.circuit is not None:
        drop = _drop(base.circuit.resistance_ohm, motion, point, effects)
        result[VOLTAGE_BALANCE] = weights.mean @ drop + weights.slope @ point.series.derivative(0, 1)
    return result


def model_readings(
    base: ActuatorModel, coenergy: CoenergySeries, motion: Motion, weights: Weights, effects: Sequence[AddedEffect]
) -> dict[str, FloatArray]:
    """What the sensors read.

    Returns
    -------
    dict of str to array, each of shape (w,)
        ``force_N``, and ``hall_V`` where the model has a sensor.
    """
    point = _excited(coenergy, motion, effects)
    readings = {"force_N": point.force}
    if base.sensor is not None:
        field = point.series.derivative(0, 0, 1)
        if any(added.effect.hall_point for added in effects):
            field = hall_field(coenergy, tuple(effects), point.distance, point.current, point.at)
        readings["hall_V"] = base.sensor.quiescent_V + base.sensor.sensitivity_V_per_T * field
    readings = recorded(effects, readings, point.distance, point.current, point.at)
    return {name: weights.mean @ reading for name, reading in readings.items()}


def _excited(coenergy: CoenergySeries, motion: Motion, effects: Sequence[AddedEffect]) -> _Point:
    at = motion.at
    d, i = true_setting(effects, motion.distance_m, motion.current_A, at)
    constant = -coenergy(d, i, 1, 1).derivative(1, 1) if any(added.memory for added in effects) else np.zeros_like(d)
    memory: dict[str, FloatArray] = {}
    for added in effects:
        memory |= states_along(added, motion.time_s, d, i, constant, at, motion.first)
    at = replace(at, memory=memory)
    series = changed_coenergy(coenergy, effects, at)(d, i, 1, 1)
    at = replace(at, motional_V=-series.derivative(1, 1) * np.asarray(at.velocity_m_s))
    force = with_further_force(effects, -series.derivative(1, 0), d, i, at)
    return _Point(d, i, at, series, force)


def _inertia(
    base: BaseMotion, motion: Motion, weights: Weights, distance: FloatArray, effects: Sequence[AddedEffect]
) -> tuple[float, FloatArray]:
    """(m_0 / m, m_0 times what the recorded acceleration lacks): another mass must not weigh its noise."""
    mass = moving_mass(effects, base.mass_kg)
    lacking = weights.curvature @ (distance - motion.distance_m)
    return base.mass_kg / mass, np.asarray(base.mass_kg * lacking)


def _drop(resistance: float, motion: Motion, point: _Point, effects: Sequence[AddedEffect]) -> FloatArray:
    """R i, and what the driver loses of its command."""
    ohms, volts = circuit_of(
        effects, np.full_like(point.current, resistance), motion.voltage_V, point.current, point.at
    )
    return np.asarray(ohms * point.current + motion.voltage_V - volts)
