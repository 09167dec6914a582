"""What a model with effects makes of a recorded motion: balances of force and voltage, and what the sensors read.

Over each window, with means <.> by its test function (:mod:`femfit.identify.series.weights`),

    force     m_0 (g - <d''>)  =  (m_0 / m) <F(d, i)> + m_0 (<d''> of the true less of the recorded d)
    voltage   <U>              =  <R i> + <d (lambda + L_s i)/dt> + <U - U_applied>

The left sides are measured, the right sides the model's; an effect changes the right sides alone. Nothing is integrated
over time, so that an unstable plant in a closed loop is no harder than a stable one.

Every state of an effect (lag, hysteresis) has a rate that is affine in that state alone, z' = a - b z with a and b
given by the motion, so that over a step of constant a and b it moves exactly to z exp(-b h) + a (1 - exp(-b h)) / b.
Eddy currents of the drawing act beside the recorded current. At given distances and currents the patterns' flux
linkages beside a current of their own are b = C^T phi + lambda, and with A = C^T L C + Q

    d(b + A e)/dt = -R e.

Between two times b is taken as linear and A as constant, so that a step is exact however fast a pattern decays. A
stretch begins at rest.
"""

from collections import ChainMap
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.linalg import lapack

from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.sweep_columns import voltage_columns
from femfit.effects.conditions import TEMPERATURES, Conditions
from femfit.effects.effect import AddedEffect
from femfit.effects.friction import REST
from femfit.effects.stages import changed_by, circuit_of, recorded, true_setting, with_further_force
from femfit.identify.observations import VOLTAGE_BALANCE, WithoutCache
from femfit.identify.series.weights import Weights
from femfit.model.actuator_model import ActuatorModel
from femfit.model.eddy_currents import EddyCurrents, EddyForms
from femfit.model.magnetics import MagneticState
from femfit.model.readings import Point, at_rest, hall_seen
from femfit.model.with_effects import eddy_with_sources

SLOWEST = 1e-12
"""Numerical: decay over a step below which a state, or a pattern of eddy current, only adds up."""

FORCE_BALANCE = "force_balance_N"

_LAST = 4
"""Numerical: settings of effects that are kept; derivatives of a fit return to the one that they start from."""

_MOVING = ("setting", "coenergy", "force", "memory", "eddy")
"""Stages that change a motion; the others leave it as it is."""


def voltage_balances(model: ActuatorModel) -> list[str]:
    """Channels of the voltages, one a circuit: ``voltage_balance_V``, or ``voltage_balance_upper_V`` of several."""
    return [name.replace("voltage", VOLTAGE_BALANCE, 1) for name in voltage_columns(model.circuit_names)]


@dataclass(frozen=True, eq=False)
class Excited:
    """A motion as effects make it: the true setting, the conditions, the force, and one flux linkage a circuit."""

    distance: FloatArray
    currents: FloatArray  # (N, circuits)
    conditions: Conditions
    force: FloatArray
    state: MagneticState  # Of the currents that act, eddy currents beside them
    induced_T: FloatArray  # What eddy currents add to the field at the Hall element


@dataclass(frozen=True, eq=False)
class Motion(WithoutCache):
    """A recorded motion of a model without effects, at N times of the record; ``first`` where a new stretch begins."""

    base: ActuatorModel
    time_s: FloatArray
    first: BoolArray
    distance_m: FloatArray
    # Shape (N, circuits)
    currents_A: FloatArray
    voltages_V: FloatArray
    conditions: Conditions

    def under(self, effects: Sequence[AddedEffect]) -> Excited:
        """The motion with the effects that act on it; it is kept while only those on mass, circuit or readings change.

        By their parameters, beside the effects themselves, so that their addresses stay theirs.
        """
        acting = [added for added in effects if any(getattr(added.effect, stage) is not None for stage in _MOVING)]
        key = tuple((id(added.effect), *added.parameters.items()) for added in acting)
        excited = self._kept.pop(key)[1] if key in self._kept else self._excited(acting)
        self._kept[key] = acting, excited
        if len(self._kept) > _LAST:
            self._kept.pop(next(iter(self._kept)))
        return excited

    @cached_property
    def _kept(self) -> dict[Hashable, tuple[Sequence[AddedEffect], Excited]]:
        return {}

    @cached_property
    def _forms(self) -> list[EddyForms]:
        return self.base.eddy.forms(self.distance_m, 0, 1) if self.base.eddy else []

    def true_setting(self, effects: Sequence[AddedEffect]) -> tuple[FloatArray, FloatArray]:
        """Distances (N,) and currents (N, n) that body and windings really had."""
        currents = self.currents_A[:, : len(self.base.validity.current_limits_A)]
        return true_setting(effects, self.distance_m, currents, self.conditions)

    def _excited(self, effects: Sequence[AddedEffect]) -> Excited:
        base, conditions = self.base, self.conditions
        d, i = self.true_setting(effects)
        first, remembering = _first(i), [added for added in effects if added.memory]
        if remembering:
            constant = at_rest(Point(base, d, i, conditions, ())).motional_constant[:, 0]
            states = [states_along(added, self, d, first, constant) for added in remembering]
            conditions = replace(conditions, memory=dict(ChainMap(*states)))
        state, eddy = at_rest(Point(base, d, i, conditions, effects)), eddy_with_sources(base, effects)
        pull, induced_T = np.zeros_like(d), np.zeros_like(d)
        if eddy is not None:
            same = eddy is base.eddy and d is self.distance_m
            forms = self._forms if same else eddy.forms(d, 0, 1)
            along = Induced.along(eddy, forms, self.time_s, self.first, state)
            state = at_rest(Point(base, d, along.acting(i), conditions, effects))
            pull, induced_T = along.pull(state.flux_linkage), (along.forms.hall * along.currents).sum(axis=1)
        if i.shape[1] == 1:
            velocity = np.asarray(conditions.velocity_m_s)
            conditions = replace(conditions, motional_V=state.motional_constant[:, 0] * velocity)
        force = with_further_force(effects, state.force + pull, d, first, conditions)
        return Excited(d, i, conditions, force, state, induced_T)


def model_side(motion: Motion, weights: Mapping[str, Weights], effects: Sequence[AddedEffect]) -> dict[str, FloatArray]:
    """The right side of each balance, and what each sensor reads, in the windows of its weights.

    Channels are the balances, of force with a motion, of voltage with a circuit; ``force_N``, ``hall_V`` with a sensor,
    and ``rest_distance_m``: where a body rests, the recorded distance is that of the stop less the error of the
    recorded distance. For that alone no field is worked out.
    """
    circuits = {name: k for k, name in enumerate(voltage_balances(motion.base))}
    readings = model_readings(motion, {*weights} - {FORCE_BALANCE, *circuits}, effects)
    result = {}
    for name, channel_weights in weights.items():
        if name == FORCE_BALANCE:
            result[name] = _force_side(motion, channel_weights, effects)
        elif name in circuits:
            result[name] = _voltage_side(motion, channel_weights, circuits[name], effects)
        else:
            result[name] = channel_weights.mean @ readings[name]
    return result


def _force_side(motion: Motion, weights: Weights, effects: Sequence[AddedEffect]) -> FloatArray:
    """Beside m_0 times what the recorded acceleration lacks: another mass must not weigh its noise.

    Springs, load and friction stand on the measured side, which another mass leaves alone.
    """
    excited, body = motion.under(effects), motion.base.require_motion()
    share = body.mass_kg / changed_by(effects, "mass", body.mass_kg)
    lacking = body.mass_kg * (weights.curvature @ (excited.distance - motion.distance_m))
    if share != 1.0:
        beside = body.beside_weight(excited.distance) + body.friction(np.asarray(motion.conditions.velocity_m_s))
        lacking = lacking + (1.0 - share) * (weights.mean @ (beside + np.zeros_like(excited.distance)))
    return np.asarray(share * (weights.mean @ excited.force) + lacking)


def _voltage_side(motion: Motion, weights: Weights, k: int, effects: Sequence[AddedEffect]) -> FloatArray:
    """Of the circuit with the place k."""
    excited, circuit, commanded = motion.under(effects), motion.base.circuits[k], motion.voltages_V[:, k]
    current, within = excited.currents[:, k], [added for added in effects if added.effect.of in ("", circuit.name)]
    ohms, applied = circuit_of(
        within, np.full_like(current, circuit.resistance_ohm), commanded, current, excited.conditions
    )
    drop = ohms * current + commanded - applied  # with what the driver loses of its command
    linked = excited.state.flux_linkage[:, k] + circuit.inductance_H * current
    return np.asarray(weights.mean @ drop + weights.slope @ linked)


def model_readings(motion: Motion, names: set[str], effects: Sequence[AddedEffect]) -> dict[str, FloatArray]:
    """What sensors read of a motion, each of shape (N,)."""
    base, conditions, readings = motion.base, motion.conditions, dict[str, FloatArray]()
    d, i = motion.true_setting(effects)
    if names - {REST}:
        excited = motion.under(effects)
        conditions, readings["force_N"] = excited.conditions, excited.force
        if base.sensor is not None:
            field = excited.induced_T + hall_seen(excited.state, Point(base, d, i, conditions, effects))
            readings["hall_V"] = base.sensor.quiescent_V + base.sensor.sensitivity_V_per_T * field
    if REST in names:
        near, far = base.require_motion().ends
        stop = np.where(np.abs(motion.distance_m - near) < np.abs(motion.distance_m - far), near, far)
        readings[REST] = np.where(np.isfinite(stop), stop, 0.0) - (d - motion.distance_m)
    return recorded(effects, readings, d, _first(i), conditions)


def _first(currents: FloatArray) -> FloatArray:
    """The current (N,) of currents (N, n) that effects without a circuit of their own are told."""
    return currents[:, :1].sum(axis=1)


@dataclass(frozen=True, eq=False)
class Induced:
    """Currents of eddy patterns along a motion.

    Without a circuit there is no current that a pattern acts like.
    """

    n: int  # Circuits that patterns act like
    # The patterns' forms at N distances and their derivatives
    forms: EddyForms
    rising: EddyForms
    currents: FloatArray  # (N, r)

    @classmethod
    def along(
        cls, eddy: EddyCurrents, along: Sequence[EddyForms], time: FloatArray, first: BoolArray, still: MagneticState
    ) -> Self:
        """Of forms and their derivatives at N points, where stretches begin ``first``, beside the circuits alone."""
        forms, rising = along
        n, root, turned = len(eddy.circuits), 1.0 / np.sqrt(eddy.resistances_ohm), np.swapaxes(forms.coupling, -1, -2)
        beside = root * ((turned @ still.flux_linkage[:, :n, None])[..., 0] + forms.flux_linkage)
        matrix = root[:, None] * (turned @ still.inductance[:, :n, :n] @ forms.coupling + forms.inductance) * root
        # What is left of A e after each step, and of a flux linkage that grows evenly within it
        delay, modes = np.linalg.eigh(0.5 * (matrix[1:] + matrix[:-1]))
        decay, back = np.maximum(np.maximum(np.diff(time), 0.0)[:, None] / delay, SLOWEST), np.swapaxes(modes, -1, -2)
        factors = (modes * np.exp(-decay)[:, None]) @ back
        grown = -np.expm1(-decay)[..., None] / decay[..., None] * (back @ -np.diff(beside, axis=0)[..., None])
        gained = (modes @ grown)[..., 0]
        factors[first[1:]], gained[first[1:]] = 0.0, 0.0
        linked = recurrence(factors, gained)
        return cls(n, forms, rising, root * np.linalg.solve(matrix, linked[..., None])[..., 0])

    def acting(self, currents: FloatArray) -> FloatArray:
        """Currents (N, n) that act on the static field like these and the induced ones together."""
        result = currents.copy()
        result[:, : self.n] += (self.forms.coupling @ self.currents[..., None])[..., 0]
        return result

    def pull(self, flux_linkage: FloatArray) -> FloatArray:
        """What they add to the force beside the static one, at flux linkages (N, n) of the currents that act."""
        acting = (self.rising.coupling @ self.currents[..., None])[..., 0]
        linkage = self.rising.flux_linkage + 0.5 * (self.rising.inductance @ self.currents[..., None])[..., 0]
        return -np.asarray((flux_linkage[:, : self.n] * acting).sum(axis=-1) + (linkage * self.currents).sum(axis=-1))


def recurrence(factors: FloatArray, gained: FloatArray) -> FloatArray:
    """x_k = K_k x_(k-1) + g_k from x_0 = 0: a triangular system of bandwidth 2 r, which LAPACK solves in one pass."""
    steps, r = gained.shape
    below = np.zeros((2 * r, steps + 1, r))  # Entry (d, j) stands d rows below the diagonal in column j
    row, column = np.indices((r, r)).reshape(2, -1)
    below[r + row - column, :-1, column] = -factors[:, row, column].T
    right = np.concatenate([np.zeros(r), gained.ravel()])
    solution, _ = lapack.dtbtrs(below.reshape(2 * r, -1), right[:, None], uplo="L", diag="U")
    return np.asarray(solution).reshape(steps + 1, r)


def states_along(
    added: AddedEffect, motion: Motion, distance: FloatArray, current: FloatArray, motional_constant: FloatArray
) -> dict[str, FloatArray]:
    """The states of an effect that has some, at every node of a true motion, at rest where a stretch begins."""
    memory, fresh, step = added.effect.memory, motion.first[1:], np.diff(motion.time_s)
    if memory is None:
        return {}
    moves = ~fresh & (step > 0.0)  # neighbouring windows share a node
    velocity, rate = (np.divide(np.diff(x), step, out=np.zeros_like(step), where=moves) for x in (distance, current))
    lasting = {name: getattr(motion.conditions, name) for name in (*TEMPERATURES, "time_s", "elapsed")}
    halfway: dict[str, Any] = {name: _between(np.broadcast_to(x, distance.shape)) for name, x in lasting.items()}
    i, motional_V = _between(current), _between(motional_constant) * velocity
    rates: dict[str, Any] = {
        "branch": np.sign(rate),
        "velocity_m_s": velocity,
        "current_rate_A_s": rate,
        "motional_V": motional_V,
    }
    moving = replace(motion.conditions, **halfway, **rates)
    at_zero, at_one = (
        memory.rate({name: np.full_like(i, z) for name in memory.names}, i, moving, added.parameters)
        for z in (0.0, 1.0)
    )
    result = {}
    for name in memory.names:
        decay = np.maximum((at_zero[name] - at_one[name]) * np.where(moves, step, 0.0), SLOWEST)
        factor = np.where(fresh, 0.0, np.exp(-decay))
        gained = np.where(moves, at_zero[name] * step * -np.expm1(-decay) / decay, 0.0)
        result[name] = recurrence(factor[:, None, None], gained[:, None])[:, 0]
    return result


def _between(values: FloatArray) -> FloatArray:
    """Values at nodes on the steps between these."""
    return 0.5 * (values[1:] + values[:-1])
