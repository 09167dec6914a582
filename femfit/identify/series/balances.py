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

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from scipy.linalg import lapack

from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.sweep_columns import voltage_columns
from femfit.device.mechanics import Mechanics
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.effects.friction import REST
from femfit.effects.stages import changed_by, circuit_of, recorded, true_setting, with_further_force
from femfit.identify.constants import SLOWEST
from femfit.identify.observations import TEMPERATURES, VOLTAGE_BALANCE
from femfit.identify.series.weights import Weights
from femfit.model.actuator_model import ActuatorModel
from femfit.model.eddy_currents import EddyCurrents, EddyForms
from femfit.model.magnetics import MagneticState
from femfit.model.readings import Point, at_rest, hall_seen
from femfit.model.with_effects import eddy_with_sources


@dataclass(frozen=True, eq=False)
class EddiesAlong:
    """The patterns' forms at N distances and their derivatives.

    Currents (N, n) without a circuit are a column of zeros, which no pattern acts like.
    """

    eddy: EddyCurrents
    distance: FloatArray
    forms: EddyForms
    rising: EddyForms

    @classmethod
    def at(cls, eddy: EddyCurrents, distance: FloatArray) -> Self:
        """At distances (N,) in m."""
        return cls(eddy, distance, *eddy.forms(distance, 0, 1))

    def acting(self, current: FloatArray, induced: FloatArray) -> FloatArray:
        """Currents (N, n) that act on the static field like these and induced ones (N, r) together."""
        result = current.copy()
        result[:, : len(self.eddy.circuits)] += (self.forms.coupling @ induced[..., None])[..., 0]
        return result


def induced_along(
    along: EddiesAlong, time: FloatArray, first: BoolArray, flux_linkage: FloatArray, inductance: FloatArray
) -> FloatArray:
    """Currents (N, r) of the patterns at N times, where stretches begin ``first``.

    Parameters
    ----------
    flux_linkage, inductance : array, shapes (N, n) and (N, n, n)
        Of the circuits, without eddy currents.
    """
    forms, root, n = along.forms, 1.0 / np.sqrt(along.eddy.resistances_ohm), len(along.eddy.circuits)
    turned = np.swapaxes(forms.coupling, -1, -2)
    beside = root * ((turned @ flux_linkage[:, :n, None])[..., 0] + forms.flux_linkage)
    matrix = root[:, None] * (turned @ inductance[:, :n, :n] @ forms.coupling + forms.inductance) * root
    factors, gained = _steps(np.diff(time), 0.5 * (matrix[1:] + matrix[:-1]), -np.diff(beside, axis=0))
    factors[first[1:]], gained[first[1:]] = 0.0, 0.0
    linked = recurrence(factors, gained)
    return np.asarray(root * np.linalg.solve(matrix, linked[..., None])[..., 0])


def pull_of(along: EddiesAlong, flux_linkage: FloatArray, induced: FloatArray) -> FloatArray:
    """What induced currents (N, r) add to the force beside the static one, at the currents that act together."""
    rising, n = along.rising, len(along.eddy.circuits)
    acting = (rising.coupling @ induced[..., None])[..., 0]
    linkage = rising.flux_linkage + 0.5 * (rising.inductance @ induced[..., None])[..., 0]
    return -np.asarray((flux_linkage[:, :n] * acting).sum(axis=-1) + (linkage * induced).sum(axis=-1))


def recurrence(factors: FloatArray, gained: FloatArray) -> FloatArray:
    """x_k = K_k x_(k-1) + g_k from x_0 = 0: a triangular system of bandwidth 2 r, which LAPACK solves in one pass."""
    steps, r = gained.shape
    below = np.zeros((2 * r, steps + 1, r))  # Entry (d, j) stands d rows below the diagonal in column j
    row, column = np.indices((r, r)).reshape(2, -1)
    below[r + row - column, :-1, column] = -factors[:, row, column].T
    right = np.concatenate([np.zeros(r), gained.ravel()])
    solution, _ = lapack.dtbtrs(below.reshape(2 * r, -1), right[:, None], uplo="L", diag="U")
    return np.asarray(solution).reshape(steps + 1, r)


def _steps(step: FloatArray, matrix: FloatArray, gained: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What is left of A e after each step in s, and of a flux linkage that grows evenly within it."""
    delay, modes = np.linalg.eigh(matrix)
    decay = np.maximum(np.maximum(step, 0.0)[:, None] / delay, SLOWEST)
    turned = np.swapaxes(modes, -1, -2)
    mean = -np.expm1(-decay) / decay
    factors = (modes * np.exp(-decay)[:, None]) @ turned
    return factors, (modes @ (mean[..., None] * (turned @ gained[..., None])))[..., 0]


FORCE_BALANCE = "force_balance_N"


def voltage_balances(model: ActuatorModel) -> list[str]:
    """Channels of the voltages, one a circuit: ``voltage_balance_V``, or ``voltage_balance_upper_V`` of several."""
    return [name.replace("voltage", VOLTAGE_BALANCE, 1) for name in voltage_columns(model.circuit_names)]


@dataclass(frozen=True, eq=False)
class Motion:
    """A recorded motion, smoothed, at n nodes on the record's clock; ``first`` where a new stretch begins.

    Currents and voltages of several circuits have the shape (n, circuits).
    """

    time_s: FloatArray
    first: BoolArray
    distance_m: FloatArray
    current_A: FloatArray
    voltage_V: FloatArray
    at: Conditions


@dataclass(frozen=True, eq=False)
class _Point:
    """A motion as effects make it: the true setting, the conditions, the force, and one flux linkage a circuit."""

    distance: FloatArray
    currents: FloatArray  # (N, circuits)
    at: Conditions
    force: FloatArray
    seen: MagneticState  # Of the currents that act, eddy currents beside them
    induced_T: FloatArray  # What eddy currents add to the field at the Hall element


def model_balances(
    points: "RememberedPoints", motion: Motion, weights: Weights, effects: Sequence[AddedEffect]
) -> dict[str, FloatArray]:
    """The right sides of the balances, each of shape (w,): of force with a motion, of voltage with a circuit."""
    base, point, result = points.base, points.at(motion, effects), {}
    if base.motion is not None:
        share, inertia = _inertia(base.motion, motion, weights, point.distance, effects)
        result[FORCE_BALANCE] = share * (weights.mean @ point.force) + inertia
    for k, (circuit, name) in enumerate(zip(base.circuits, voltage_balances(base), strict=True)):
        several, current = bool(point.at.nominal.circuits), point.currents[:, k]
        volts = motion.voltage_V[:, k] if several else motion.voltage_V
        of_circuit = [added for added in effects if added.effect.of == circuit.name] if several else effects
        ohms, applied = circuit_of(of_circuit, np.full_like(current, circuit.resistance_ohm), volts, current, point.at)
        drop = ohms * current + volts - applied  # with what the driver loses of its command
        result[name] = weights.mean @ drop + weights.slope @ (
            point.seen.flux_linkage[:, k] + circuit.inductance_H * current
        )
    return result


def model_readings(
    points: "RememberedPoints", motion: Motion, weights: Weights, effects: Sequence[AddedEffect]
) -> dict[str, FloatArray]:
    """What the sensors read, each of shape (w,): ``force_N``, a sensor's ``hall_V``, a motion's ``rest_distance_m``.

    Where a body rests, the recorded distance is that of the stop less the error of the recorded distance.
    """
    base, point = points.base, points.at(motion, effects)
    readings = {"force_N": point.force}
    if base.sensor is not None:
        field = point.induced_T + hall_seen(point.seen, Point(base, point.distance, point.currents, point.at, effects))
        readings["hall_V"] = base.sensor.quiescent_V + base.sensor.sensitivity_V_per_T * field
    readings = recorded(effects, readings, point.distance, _first(point.currents), point.at)
    rests = model_rests(points, motion, weights, effects) if base.motion is not None else {}
    return {name: weights.mean @ reading for name, reading in readings.items()} | rests


def model_rests(
    points: "RememberedPoints", motion: Motion, weights: Weights, effects: Sequence[AddedEffect]
) -> dict[str, FloatArray]:
    """The same of ``rest_distance_m`` alone, for which no field is worked out."""
    base, d = points.base, motion.distance_m
    near, far = base.require_motion().ends
    stop = np.where(np.abs(d - near) < np.abs(d - far), near, far)
    true, i = true_setting(effects, d, base.validity.with_axis(motion.current_A), motion.at)
    readings = {REST: np.where(np.isfinite(stop), stop, 0.0) - (true - d)}
    return {REST: weights.mean @ recorded(effects, readings, true, _first(i), motion.at)[REST]}


def _excited(points: "RememberedPoints", motion: Motion, effects: Sequence[AddedEffect]) -> _Point:
    base, conditions = points.base, motion.at
    d, i = true_setting(effects, motion.distance_m, base.validity.with_axis(motion.current_A), motion.at)
    first = _first(i)
    if any(added.memory for added in effects):
        constant = at_rest(Point(base, d, i, conditions, ())).motional_constant[:, 0]
        memory: dict[str, FloatArray] = {}
        for added in effects:
            memory |= states_along(added, motion.time_s, d, first, constant, conditions, motion.first)
        conditions = replace(conditions, memory=memory)
    u, pull, induced_T, eddy = i, np.zeros_like(d), np.zeros_like(d), eddy_with_sources(base, effects)
    if eddy is not None:
        still, along = at_rest(Point(base, d, i, conditions, effects)), points.eddies(eddy, d)
        induced = induced_along(along, motion.time_s, motion.first, still.flux_linkage, still.inductance)
        u, induced_T = along.acting(i, induced), (along.forms.hall * induced).sum(axis=1)
    seen = at_rest(Point(base, d, u, conditions, effects))
    if eddy is not None:
        pull = pull_of(along, seen.flux_linkage, induced)
    if i.shape[1] == 1:
        conditions = replace(conditions, motional_V=seen.motional_constant[:, 0] * np.asarray(conditions.velocity_m_s))
    force = with_further_force(effects, seen.force + pull, d, first, conditions)
    return _Point(d, i, conditions, force, seen, induced_T)


def _first(currents: FloatArray) -> FloatArray:
    """The current (N,) of currents (N, n) that effects without a circuit of their own are told."""
    return currents[:, :1].sum(axis=1)


def _inertia(
    base: Mechanics, motion: Motion, weights: Weights, distance: FloatArray, effects: Sequence[AddedEffect]
) -> tuple[float, FloatArray]:
    """(m_0 / m, m_0 times what the recorded acceleration lacks): another mass must not weigh its noise.

    Springs, load and friction stand on the measured side, which another mass leaves alone.
    """
    share = base.mass_kg / changed_by(effects, "mass", base.mass_kg)
    lacking = base.mass_kg * (weights.curvature @ (distance - motion.distance_m))
    if share != 1.0:
        beside = base.beside_weight(distance) + base.friction(np.asarray(motion.at.velocity_m_s))
        lacking = lacking + (1.0 - share) * (weights.mean @ (beside + np.zeros_like(distance)))
    return share, np.asarray(lacking)


def states_along(
    added: AddedEffect,
    time: FloatArray,
    distance: FloatArray,
    current: FloatArray,
    motional_constant: FloatArray,
    conditions: Conditions,
    first: BoolArray,
) -> dict[str, FloatArray]:
    """The states of one effect at every node, at rest where a stretch begins (``first``); empty where it needs none."""
    memory = added.memory
    if memory is None:
        return {}
    fresh, step = first[1:], np.diff(time)
    moves = ~fresh & (step > 0.0)  # neighbouring windows share a node
    velocity, rate = (np.divide(np.diff(x), step, out=np.zeros_like(step), where=moves) for x in (distance, current))
    i, constant = (_between(x) for x in (current, motional_constant))
    names = (*TEMPERATURES, "time_s", "elapsed")
    halfway: dict[str, Any] = {name: _between(np.broadcast_to(getattr(conditions, name), time.shape)) for name in names}
    moving = replace(
        conditions,
        branch=np.sign(rate),
        velocity_m_s=velocity,
        current_rate_A_s=rate,
        motional_V=constant * velocity,
        **halfway,
    )
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


_LAST_POINTS = 4
"""Numerical: motions that are kept; derivatives of a fit return to the one that they start from."""


@dataclass(frozen=True, eq=False)
class RememberedPoints:
    """A motion as effects make it, kept while only effects on mass, circuit or readings change."""

    base: ActuatorModel
    # By motion and parameters, with the effects themselves, so that their addresses stay theirs
    known: dict[Hashable, tuple[Motion, Sequence[AddedEffect], _Point]] = field(default_factory=dict)
    still: list[EddiesAlong] = field(default_factory=list)  # The last eddy currents and distances

    def eddies(self, eddy: EddyCurrents, distance: FloatArray) -> EddiesAlong:
        """Eddy currents along distances, worked out once for these very arrays."""
        if not any(along.eddy is eddy and along.distance is distance for along in self.still):
            self.still[:] = [EddiesAlong.at(eddy, distance)]
        return self.still[0]

    def at(self, motion: Motion, effects: Sequence[AddedEffect]) -> _Point:
        """The motion with the effects that act on it."""
        stages = ("setting", "coenergy", "force", "memory", "eddy")  # the others leave the motion as it is
        acting = [added for added in effects if any(getattr(added.effect, stage) is not None for stage in stages)]
        key = id(motion), *((id(added.effect), *added.parameters.items()) for added in acting)
        point = self.known.pop(key, None) or (motion, acting, _excited(self, motion, acting))
        self.known[key] = point
        if len(self.known) > _LAST_POINTS:
            self.known.pop(next(iter(self.known)))
        return point[2]


Side = Callable[[RememberedPoints, Motion, Weights, Sequence[AddedEffect]], dict[str, FloatArray]]
"""What a model with effects makes of a motion in each window, by channel: balances, or what sensors read."""
