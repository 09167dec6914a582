"""Motion, current and Hall reading under effects that act while something moves or changes.

State (d, v, i, z): z are the effects' own states (lag, hysteresis). With W'(d, i, z) as the effects change it,
v' is that of the mechanics under F = -dW'/dd + what the effects add, and from U = R i + d(flux linkage)/dt

    (L + dl/dz . dz'/di') i' = U - R i + k_m v - dl/dz . z'(i' = 0),

since z' grows linearly with i' for each of its signs, and the bracket keeps the sign of the right side.

Eddy currents e (:mod:`femfit.model.eddy_currents`) are windings beside: W' is changed as a function of u = i + C e,
states that change it follow u, and the equation stands for all currents w = (i, e) with G = (1, C),

    L w' + G^T s u' = U - R w + k_m v - G^T dl/dz . z'(u' = 0),  u' = G w' + C' e v,  s = dl/dz . dz'/du'.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), sections 3.1 and 5.1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.device.mechanics import Mechanics
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect, Memory
from femfit.effects.stages import changed_coenergy, circuit_of, hall_point, recorded, with_further_force
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries
from femfit.model.eddy_currents import EddyCurrents
from femfit.model.eddy_magnetics import with_eddies
from femfit.model.magnetics import MagneticState
from femfit.model.windings import decay_of, solved

_PROBE = 1e-3
"""Step of a difference in a state, which is of the order of one."""

_LEAKAGE = 0.05
"""Least part of the inductance that a changing state leaves: leakage flux passes air, whatever the core does."""


@dataclass(frozen=True, eq=False)
class EffectDynamics:
    """Effects at work in plant and filters."""

    # The co-energy without what ``later`` does to it, without and with the field at the Hall element
    motion_coenergy: CoenergySeries
    hall_coenergy: CoenergySeries
    effects: tuple[AddedEffect, ...]
    later: tuple[AddedEffect, ...]  # Those of the effects whose change of the co-energy depends on states
    at: Conditions
    resistance_ohm: float
    series_H: float = 0.0  # Inductance in series with the winding, outside of the field
    eddy: EddyCurrents | None = None

    @cached_property
    def memories(self) -> tuple[tuple[AddedEffect, Memory], ...]:
        """Effects whose parameters need states."""
        return tuple((added, added.memory) for added in self.effects if added.memory is not None)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the states z."""
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
        """C and t of every state as in :class:`Memory`, shape (2, len(names)); None where one acts otherwise."""
        found, growing = dict.fromkeys(self.names, (0.0, 0.0)), 0
        for added in self.later:
            memory = added.memory
            if memory is None or memory.lag is None:
                return None
            own = memory.lag(self.at, added.parameters)
            growing += any(taper for _, taper in own.values())
            found |= own
        return np.array(list(found.values())).reshape(-1, 2).T if growing <= 1 else None

    def derivative(
        self,
        state: FloatArray,
        voltage: FloatArray,
        disturbance: FloatArray | float,
        mechanics: Mechanics,
        sample_time_s: float,
        current_rate: float | None = None,
        mean_over: float = 0.0,
    ) -> FloatArray:
        """Time derivative of (distance, velocity, current, states); arguments as in :mod:`femfit.model.dynamics`.

        Parameters
        ----------
        mean_over : float
            Step in s over which velocity and current change by their mean rates, as in
            :mod:`femfit.model.exponential_step`, at a held distance; the derivative itself for none.
        current_rate : float or None
            In A/s where something else than the voltage decides it: an amplifier, or a diode that blocks.
        """
        flat = state.reshape(-1, state.shape[-1])
        volts = np.broadcast_to(voltage, state.shape[:-1]).ravel()
        if np.ndim(disturbance):
            disturbance = np.broadcast_to(disturbance, state.shape[:-1]).ravel()
        end = 3 if self.eddy is None else 3 + self.eddy.count
        d, v, w = flat[:, 0], flat[:, 1], flat[:, 2:end]
        memory = dict(zip(self.names, flat[:, end:].T, strict=True))
        magnetic, slopes, g, drift = self._all_magnetics(memory, d, v, w)
        u = (g * w).sum(axis=1)
        motional = magnetic.motional_constant * v[:, None]
        at = replace(self.at, velocity_m_s=v, memory=memory, motional_V=motional[:, 0])
        force = with_further_force(self.effects, magnetic.force, d, w[:, 0], at)
        acceleration = mechanics.acceleration(d, v, force - disturbance, sample_time_s)
        if mean_over:
            motional = magnetic.motional_constant * (v + 0.5 * mean_over * acceleration)[:, None]
            at = replace(at, motional_V=motional[:, 0])
        resistances, driving = np.empty_like(w), np.zeros_like(w)
        if self.eddy is not None:
            resistances[:, 1:] = self.eddy.resistances_ohm
        own = np.full_like(u, self.resistance_ohm)
        resistances[:, 0], driving[:, 0] = circuit_of(self.effects, own, volts, w[:, 0], at)
        driving += motional - resistances * w
        inductance = magnetic.inductance.copy()
        inductance[:, 0, 0] += self.series_H
        if self.names:
            still = self._rates(memory, u, np.zeros_like(u), at)
            driving = driving - g * (slopes * still).sum(axis=0)[:, None]
            both = solved(inductance, np.stack([driving, g], axis=2))
            free, share = np.einsum("pa,pak->kp", g, both)  # u' without what the states take, and by a volt on u
            sign = np.where(free + drift < 0.0, -1.0, 1.0)
            slope = sign * (self._rates(memory, u, sign, at) - still)
            taken = np.maximum((slopes * slope).sum(axis=0), (_LEAKAGE - 1.0) / share)
            driving = driving - g * (taken * drift)[:, None]
            inductance = inductance + taken[:, None, None] * g[:, :, None] * g[:, None, :]
        rate = solved(inductance, driving[..., None])[..., 0]
        if mean_over:
            rate, lever = decay_of(inductance, resistances, mean_over).parts(rate)
            pull = (magnetic.motional_constant * lever).sum(axis=1)
            acceleration = acceleration - mean_over / mechanics.mass_kg * pull
        if current_rate is not None:  # the voltage is whatever holds it
            by_volt = np.linalg.inv(inductance)[:, :, 0]
            rate = rate + by_volt / by_volt[:, :1] * (current_rate - rate[:, :1])
        result = np.empty((len(flat), end + len(self.names)))
        result[:, 0], result[:, 1], result[:, 2:end] = v, acceleration, rate
        if self.names:
            followed = (w[:, 0], rate[:, 0])
            result[:, end:] = self._rates(memory, u, (g * rate).sum(axis=1) + drift, at, followed).T
        return result.reshape(state.shape)

    def _all_magnetics(
        self, memory: Mapping[str, FloatArray], d: FloatArray, v: FloatArray, w: FloatArray
    ) -> tuple[MagneticState, FloatArray, FloatArray, FloatArray]:
        """Those of all currents, dl/dz (names, N), G (N, n + r), and u' at held currents."""
        g, drift = np.ones_like(w), np.zeros_like(d)
        if self.eddy is not None:
            shifted, rising = self.eddy.whole_forms(d, 0, 1)
            g, drift = shifted.coupling[:, 0], (rising.coupling[:, 0] * w).sum(axis=1) * v
        static, slopes, flux = self._magnetics(memory, d, (g * w).sum(axis=1))
        magnetic = MagneticState(static.force, static.motional_constant[:, None], static.inductance[:, None, None])
        if self.eddy is not None:
            magnetic = with_eddies(shifted, rising, w, magnetic, flux[:, None])
        return magnetic, slopes, g, drift

    def _rates(
        self,
        memory: Mapping[str, FloatArray],
        i: FloatArray,
        current_rate: FloatArray,
        at: Conditions,
        of_circuit: tuple[FloatArray, FloatArray] | None = None,
    ) -> FloatArray:
        """Rates z' of shape (len(names), n).

        Parameters
        ----------
        of_circuit : (array, array) or None
            The circuit's current and its rate, which a sensor's states follow, where the core's are others.
        """
        rates: dict[str, FloatArray] = {}
        for added, own in self.memories:
            now, rate = (i, current_rate) if of_circuit is None or added in self.later else of_circuit
            rates.update(own.rate(memory, now, replace(at, current_rate_A_s=rate), added.parameters))
        return np.stack([rates[name] for name in self.names])

    def _magnetics(
        self, memory: Mapping[str, FloatArray], d: FloatArray, i: FloatArray
    ) -> tuple[MagneticState, FloatArray, FloatArray]:
        """Force, motional constant and inductance; the flux linkage's derivatives in the states, (names, n); and it."""
        if not self.names:
            series = self.motion_coenergy(d, i, 1, 2)
            return _state(series), np.zeros((0, len(i))), series.derivative(0, 1)
        states = np.stack(list(memory.values()))
        if self.lags is None:
            series = changed_coenergy(self.motion_coenergy, self.later, replace(self.at, memory=memory))(d, i, 1, 2)
            return _state(series), self._flux_differences(states, d, i), series.derivative(0, 1)
        lag, taper = self.lags
        if not np.any(taper):
            series = self.motion_coenergy(d, i - lag @ states, 1, 2)
            seen = _state(series)
            return seen, -lag[:, None] * seen.inductance, series.derivative(0, 1)
        series = self.motion_coenergy(d, i - lag @ states, 1, 3)
        seen, linkage = _state(series), series.derivative(0, 1)
        # W' = V - g(lambda): its derivatives by the chain rule
        second = taper @ states
        first = second * linkage
        kept = 1.0 - second * seen.inductance
        force = seen.force - first * seen.motional_constant
        motional = seen.motional_constant * kept + first * series.derivative(1, 2)
        inductance = seen.inductance * kept - first * series.derivative(0, 3)
        own = taper[:, None] * linkage * seen.inductance
        return MagneticState(force, motional, inductance), -lag[:, None] * inductance - own, kept * linkage

    def _flux_differences(self, states: FloatArray, d: FloatArray, i: FloatArray) -> FloatArray:
        """The flux linkage's derivative in each state by central differences, all of them at once."""
        count = len(states)
        probes = _PROBE * np.concatenate([np.eye(count), -np.eye(count)], axis=1)[:, :, None]
        moved = (states[:, None] + probes).reshape(count, -1)
        at = replace(self.at, memory=dict(zip(self.names, moved, strict=True)))
        coenergy = changed_coenergy(self.motion_coenergy, self.later, at)
        flux = coenergy(np.tile(d, 2 * count), np.tile(i, 2 * count), 0, 1).derivative(0, 1).reshape(2, count, -1)
        return np.asarray((flux[0] - flux[1]) / (2.0 * _PROBE))

    def hall_voltage(
        self, state: FloatArray, quiescent: float, sensitivity: float, time: FloatArray | float
    ) -> FloatArray:
        """Output of the Hall element before clipping and rounding, from the quiescent voltage and V/T of the base's."""
        flat = state.reshape(-1, state.shape[-1])
        d, v, i = flat[:, 0], flat[:, 1], flat[:, 2]
        eddies = 0 if self.eddy is None else self.eddy.count
        memory = dict(zip(self.names, flat[:, 3 + eddies :].T, strict=True))
        at = replace(self.at, velocity_m_s=v, memory=memory, time_s=time, elapsed=time)
        then_d, then_i = hall_point(self.effects, d, i, at)
        further: FloatArray | float = 0.0
        if self.eddy is not None:
            e = flat[:, 3 : 3 + eddies]
            (own,) = self.eddy.forms(then_d)
            then_i, further = then_i + (own.coupling[:, 0] * e).sum(axis=1), (own.hall * e).sum(axis=1)
        series = changed_coenergy(self.hall_coenergy, self.later, at)(then_d, then_i, 0, 0)
        volts = quiescent + sensitivity * (series.derivative(0, 0, 1) + further)
        return self.read(volts, d, i, at).reshape(state.shape[:-1])

    def read(self, volts: FloatArray, distance: FloatArray, current: FloatArray, at: Conditions) -> FloatArray:
        """A Hall voltage (n,) as the sensor's effects change it at distances and currents (n,)."""
        return recorded(self.effects, {"hall_V": volts}, distance, current, at)["hall_V"]


def _state(series: TaylorSeries) -> MagneticState:
    return MagneticState(-series.derivative(1, 0), -series.derivative(1, 1), series.derivative(0, 2))
