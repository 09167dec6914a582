"""Motion, current and Hall reading under effects that act while something moves or changes.

State (d, v, i, z): z are the effects' own states (lag, hysteresis). With W'(d, i, z) as the effects change it,
v' = g + (disturbance - F) / m, F = -dW'/dd + friction, and from U = R i + d(flux linkage)/dt

    (L + dl/dz . dz'/di') i' = U - R i + k_m v - dl/dz . z'(i' = 0),

since z' grows linearly with i' for each of its signs, and the bracket keeps the sign of the right side.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), sections 3.1 and 5.1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect, Memory
from femfit.effects.jet import CoenergyJet
from femfit.model.coenergy_jet import changed_jet

_PROBE = 1e-3
"""Length of the difference along the states, which are of the order of one."""

_LEAKAGE = 0.05
"""Least part of the inductance that a changing state leaves: leakage flux passes air, whatever the core does."""


@dataclass(frozen=True, eq=False)
class EffectDynamics:
    """Effects at work in plant and filters.

    Parameters
    ----------
    motion_jet, hall_jet : callable
        The co-energy without what ``later`` does to it, without and with the field at the Hall element.
    effects : tuple of AddedEffect
        In the order of adding.
    later : tuple of AddedEffect
        Those of the effects whose change of the co-energy depends on states, and what was added after them.
    at : Conditions
        Nominal values and temperatures.
    resistance_ohm : float
        Of the base.
    """

    motion_jet: CoenergyJet
    hall_jet: CoenergyJet
    effects: tuple[AddedEffect, ...]
    later: tuple[AddedEffect, ...]
    at: Conditions
    resistance_ohm: float

    @cached_property
    def memories(self) -> tuple[tuple[AddedEffect, Memory], ...]:
        """Effects whose parameters need states."""
        return tuple((added, added.memory) for added in self.effects if added.memory is not None)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the states z."""
        return tuple(name for _, memory in self.memories for name in memory.names)

    @cached_property
    def spreads(self) -> FloatArray:
        """Standard deviation of each state where a filter starts."""
        return np.array([memory.spread for _, memory in self.memories for _ in memory.names])

    @cached_property
    def drives(self) -> bool:
        """Whether the equations of motion and current differ from those of the model's W', R and m."""
        return bool(self.names) or any(added.effect.force or added.effect.circuit for added in self.effects)

    @cached_property
    def late(self) -> bool:
        """Whether the Hall reading belongs to an earlier point."""
        return any(added.effect.hall_point for added in self.effects)

    @cached_property
    def lags(self) -> FloatArray | None:
        """Current in A that a unit of each state takes from what the co-energy sees; None where they act otherwise."""
        found = dict.fromkeys(self.names, 0.0)
        for added in self.later:
            memory = added.memory
            own = memory.lag(self.at, added.parameters) if memory is not None and memory.lag is not None else None
            if own is None:
                return None
            found |= own
        return np.array(list(found.values()))

    def derivative(
        self,
        state: FloatArray,
        voltage: FloatArray,
        disturbance: FloatArray | float,
        mass: float,
        gravity: float,
    ) -> FloatArray:
        """Time derivative of (distance, velocity, current, states).

        Parameters
        ----------
        state : array, shape (..., 3 + len(names))
            m, m/s, A, pure numbers.
        voltage : array, shape (...)
            As commanded, in V.
        disturbance : array or float
            Further force along growing distance, in N.
        mass, gravity : float
            In kg and m/s^2.

        Returns
        -------
        array, shape (..., 3 + len(names))
            Per second.
        """
        flat = state.reshape(-1, state.shape[-1])
        d, v, i = flat[:, 0], flat[:, 1], flat[:, 2]
        volts = np.broadcast_to(voltage, state.shape[:-1]).ravel()
        memory = dict(zip(self.names, flat[:, 3:].T, strict=True))
        at = replace(self.at, velocity_m_s=v, memory=memory)
        if self.lags is None:
            series = changed_jet(self.motion_jet, self.later, at)(d, i, 1, 2)
        else:
            series = self.motion_jet(d, i - flat[:, 3:] @ self.lags, 1, 2)
        motional = -series.derivative(1, 1) * v
        at = replace(at, motional_V=motional)
        force, resistance = -series.derivative(1, 0), np.full_like(i, self.resistance_ohm)
        for added in self.effects:
            if added.effect.force is not None:
                force = force + added.effect.force(d, i, at, added.parameters)
            if added.effect.circuit is not None:
                resistance, volts = added.effect.circuit(resistance, volts, i, at, added.parameters)
        rest = volts - resistance * i + motional
        inductance = series.derivative(0, 2)
        rates = np.zeros((len(self.names), len(flat)))
        if self.names:
            still = self._rates(memory, d, v, i, np.zeros_like(i), at)
            change = partial(self._flux_change, inductance, memory, d, i, at)
            rest = rest - change(still)
            sign = np.where(rest < 0.0, -1.0, 1.0)
            slope = sign * (self._rates(memory, d, v, i, sign, at) - still)
            least = _LEAKAGE * inductance
            inductance = np.maximum(inductance + change(slope), least)
            rates = still + slope * (rest / inductance)
        acceleration = gravity + (np.broadcast_to(disturbance, state.shape[:-1]).ravel() - force) / mass
        return np.concatenate([[v, acceleration, rest / inductance], rates]).T.reshape(state.shape)

    def _rates(
        self,
        memory: Mapping[str, FloatArray],
        d: FloatArray,
        v: FloatArray,
        i: FloatArray,
        current_rate: FloatArray,
        at: Conditions,
    ) -> FloatArray:
        """Rates z' of shape (len(names), n)."""
        rates: dict[str, FloatArray] = {}
        for added, own in self.memories:
            rates.update(own.rate(memory, d, v, i, current_rate, at, added.parameters))
        return np.stack([rates[name] for name in self.names])

    def _flux_change(
        self,
        inductance: FloatArray,
        memory: Mapping[str, FloatArray],
        d: FloatArray,
        i: FloatArray,
        at: Conditions,
        along: FloatArray,
    ) -> FloatArray:
        """Derivative of the flux linkage along a direction of the states; by a central difference where it must be."""
        if self.lags is not None:
            return -inductance * (self.lags @ along)
        if not along.any():
            return np.zeros_like(i)
        length = np.maximum(np.abs(along).max(axis=0), np.finfo(np.float64).tiny)
        ends = []
        for side in (_PROBE, -_PROBE):
            moved = {name: memory[name] + side * part / length for name, part in zip(self.names, along, strict=True)}
            jet = changed_jet(self.motion_jet, self.later, replace(at, memory=moved))
            ends.append(jet(d, i, 0, 1).derivative(0, 1))
        return np.asarray((ends[0] - ends[1]) * (length / (2.0 * _PROBE)))

    def hall_voltage(
        self, state: FloatArray, quiescent: float, sensitivity: float, time: FloatArray | float
    ) -> FloatArray:
        """Output of the Hall element before clipping and rounding.

        Parameters
        ----------
        state : array, shape (..., 3 + len(names))
            As in :meth:`derivative`.
        quiescent, sensitivity : float
            Of the base's sensor, in V and V/T.
        time : float
            Since the start, in s: for drifts.

        Returns
        -------
        array, shape (...)
            In V.
        """
        flat = state.reshape(-1, state.shape[-1])
        d, v, i = flat[:, 0], flat[:, 1], flat[:, 2]
        memory = dict(zip(self.names, flat[:, 3:].T, strict=True))
        at = replace(self.at, velocity_m_s=v, memory=memory, time_s=time, elapsed=time)
        then_d, then_i = seen_point(self.effects, d, i, at)
        series = changed_jet(self.hall_jet, self.later, at)(then_d, then_i, 0, 0)
        volts = quiescent + sensitivity * series.derivative(0, 0, 1)
        return self.read(volts, d, i, at).reshape(state.shape[:-1])

    def read(self, volts: FloatArray, distance: FloatArray, current: FloatArray, at: Conditions) -> FloatArray:
        """A Hall voltage as the sensor's effects change it.

        Parameters
        ----------
        volts : array, shape (n,)
            Without them.
        distance, current : array, shape (n,)
            In m and A.
        at : Conditions
            Of every point.

        Returns
        -------
        array, shape (n,)
            In V.
        """
        values: Mapping[str, FloatArray] = {"hall_V": volts}
        for added in self.effects:
            if added.effect.readings is not None:
                values = added.effect.readings(values, distance, current, at, added.parameters)
        return values["hall_V"]


def seen_point(
    effects: tuple[AddedEffect, ...], distance: FloatArray, current: FloatArray, at: Conditions
) -> tuple[FloatArray, FloatArray]:
    """Distance and current that a Hall reading belongs to: of earlier, where it is late.

    Parameters
    ----------
    effects : tuple of AddedEffect
        In the order of adding.
    distance, current : array, shape (n,)
        Now, in m and A.
    at : Conditions
        Of every point.

    Returns
    -------
    tuple of two arrays, shape (n,)
        In m and A.
    """
    for added in effects:
        if added.effect.hall_point is not None:
            distance, current = added.effect.hall_point(distance, current, at, added.parameters)
    return distance, current


def hall_field(
    jet: CoenergyJet, effects: tuple[AddedEffect, ...], distance: FloatArray, current: FloatArray, at: Conditions
) -> FloatArray:
    """Field that a Hall reading shows: that of an earlier point, where it is late.

    Parameters
    ----------
    jet : callable
        The base's co-energy.
    effects : tuple of AddedEffect
        In the order of adding.
    distance, current : array, shape (n,)
        Now, in m and A.
    at : Conditions
        Of every point.

    Returns
    -------
    array, shape (n,)
        In T.
    """
    distance, current = seen_point(effects, distance, current, at)
    return changed_jet(jet, effects, at)(distance, current, 0, 0).derivative(0, 0, 1)
