"""A sample of a filter: one, two or four steps of the equations, between the stops, beside freewheel diodes.

A filter that runs, one that is exported, a record that is followed and a bound all take these steps.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import of_variable
from femfit.core.numerics import BoolArray, FloatArray
from femfit.model.contact import between, met_stops
from femfit.model.decay import decayed, eliminated
from femfit.model.equations import Diode

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel

MOST_STEPS, ALIKE, SPEED = 4, 4e-3, 0.005
"""Chosen: a step of second order is then off by 5.3e-3 of the change that a sample brings, where four suffice; bodies
cross their stroke in two hundred samples."""

COARSE = 0.01
"""Conventional: an error of a sample, as a part of its change, of which users are told."""

LEAST_WITHIN, TINY = 0.1, 1e-300
"""Chosen: part of the states that must stay in the domain for a judgement of a sample; numerical."""


@dataclass(frozen=True, eq=False)
class SampleStep:
    """The steps in a sample of a model with motion."""

    model: "ActuatorModel"

    @property
    def count(self) -> int:
        """Steps in a sample: half their length changes what a sample brings by less than :data:`ALIKE`, if four do."""
        return self._chosen[0]

    @property
    def error(self) -> float:
        """Part of what a sample changes by which its steps are off; infinite where no body stays in the domain."""
        return self._chosen[1]

    @cached_property
    def _chosen(self) -> tuple[int, float]:
        if not self.model.circuits:
            return 1, 0.0
        last, (states, volts) = 2 + len(self.model.circuits), self._all_over()
        count, (ends, within) = 1, self._after(states, volts, 1)
        while True:
            finer, inside = self._after(states, volts, 2 * count)
            judged = within & inside  # beyond the domain no model says how far a body comes
            moved, apart = (np.square((finer - other)[1:last, judged]).sum(axis=1) for other in (states, ends))
            enough = judged.mean() > LEAST_WITHIN
            off = float(np.sqrt(apart / np.maximum(moved, TINY)).max()) if enough else float("inf")
            if off <= ALIKE or count == MOST_STEPS:
                return count, off / 0.75
            count, ends, within = 2 * count, finer, inside

    def _all_over(self) -> tuple[FloatArray, FloatArray]:
        """States (order, N) all over the validity domain, of bodies that move both ways, and voltages (n, N)."""
        model, box, n = self.model, self.model.validity, len(self.model.circuits)
        distance, currents = box.grid(5, 5, several=3)
        speed = SPEED * (box.distance_max_m - box.distance_min_m) / model.sample_time_s
        limits = np.array([(circuit.voltage_min_V, circuit.voltage_max_V) for circuit in model.circuits]).T
        limits = np.where(np.isfinite(limits), limits, box.current_limits_A[:n].T * model.resistances_ohm)
        cases = [(v, u) for v in (-speed, speed) for u in limits]
        states = np.zeros((model.order, len(cases), len(distance)))
        states[0], states[2 : 2 + n] = distance, currents[:, :n].T[:, None]
        states[1] = np.array([v for v, _ in cases])[:, None]
        volts = np.repeat(np.array([u for _, u in cases]).T[..., None], len(distance), axis=2)
        return states.reshape(model.order, -1), volts.reshape(n, -1)

    def _after(self, states: FloatArray, volts: FloatArray, count: int) -> tuple[FloatArray, BoolArray]:
        """States (order, N) a sample later by so many steps, and whether they stayed in the domain all the time."""
        box, last = self.model.validity, 2 + len(self.model.circuits)
        length, points = self.model.sample_time_s / count, states.shape[1]
        others, within = np.tile([[0.0], [length], [0.0], [1.0]], (1, points)), np.ones(points, dtype=np.bool_)
        for _ in range(count):
            states = self.model.equations.step(length)(states, volts, others, self.model.magnetics.given_values)
            within &= box.contains(states[0], states[2:last].T)
        return states, within

    def after(self, state: SX, voltage: SX, held: bool = False) -> SX:
        """An expression's state one of :attr:`count` steps later, of a body between its stops, or that stands still.

        Across a winding whose voltage is nought the freewheel diode has its drop while a current goes on.
        """
        equations, motion = self.model.equations, self.model.require_motion()
        length, state = self.model.sample_time_s / self.count, self.blocked(state)
        voltage, diodes = self.fed(voltage, state)
        if held:
            still = ca.vertcat(state[0], 0.0, state[2:])
            return self.blocked(equations.step_at(still, voltage, length, SX(0.0), diodes=diodes))
        state = ca.vertcat(between(state[0], motion.ends), state[1:])
        after = equations.step_at(state, voltage, length, stops=motion, diodes=diodes)
        distance, velocity = met_stops(motion, (state[0], state[1]), (after[0], after[1]), length)
        return self.blocked(ca.vertcat(distance, velocity, after[2:]))

    def fed(self, voltage: SX, state: SX) -> tuple[SX, list[Diode]]:
        """Voltages across the windings, and the diodes, which keep a current going until it is nought."""
        result, diodes = SX(voltage), []
        for k, drop in self.model.diodes:
            idle = voltage[k] == 0.0
            result[k] = ca.if_else(ca.logic_and(idle, state[2 + k] > 0.0), -drop, voltage[k])
            diodes.append(Diode(k, idle, -drop - result[k]))
        return result, diodes

    def freewheeling(self, state: SX, voltage: SX, length: SX) -> SX:
        """Voltages held over a step of any length in s, as :func:`femfit.model.drive.winding_voltage` has them."""
        equations, windings, n = self.model.equations, self.model.windings, len(self.model.circuits)
        d, v, w, memory = equations.parts(state)
        coenergy, resistances = equations.coenergy(memory), SX(windings.resistances_ohm)
        slopes = of_variable(
            lambda x: ca.vec(ca.jacobian(ca.gradient(coenergy(x[0], x[1:]), x)[1:], x)), ca.vertcat(d, w)
        )
        slopes = ca.reshape(slopes, w.numel(), w.numel() + 1)
        driving, inductance = -slopes[:, 0] * v - resistances * w, slopes[:, 1:] + SX(windings.series_H)
        gain = length * decayed(inductance, ca.diag(resistances), SX.eye(w.numel()), length)[0]
        result = ca.vertcat(voltage, SX.zeros(w.numel() - n))
        for k, drop in self.model.diodes:
            result[k] = ca.if_else(voltage[k] > 0.0, voltage[k], ca.if_else(w[k] > 0.0, -drop, 0.0))
        for k, drop in self.model.diodes:
            others = result + driving
            others[k] = driving[k]
            needed = -(w[k] + gain[k, :] @ others) / gain[k, k]
            result[k] = ca.if_else(voltage[k] > 0.0, voltage[k], ca.fmax(needed, -drop))
        return result[:n]

    def blocked(self, state: SX) -> SX:
        """A state whose currents do not turn round where a diode feeds the winding; eddy currents keep their flux."""
        if not self.model.diodes:
            return state
        n, end = len(self.model.circuits), self.model.windings.end
        currents = [*ca.vertsplit(state[2:end])]
        for k, _ in self.model.diodes:
            currents[k] = ca.if_else(currents[k] < 0.0, 0.0, currents[k])
        if self.model.eddy is not None:
            coenergy = self.model.equations.coenergy(self.model.equations.parts(state)[3])
            linked = of_variable(
                lambda x: ca.vec(ca.hessian(coenergy(x[0], x[1:]), x)[0][1:, 1 + n :]),
                ca.vertcat(state[0], state[2:end]),
            )
            linked = ca.reshape(linked, end - 2, end - 2 - n)
            lost = linked[:n, :].T @ (ca.vertcat(*currents[:n]) - state[2 : 2 + n])
            currents[n:] = ca.vertsplit(state[2 + n : end] - eliminated(linked[n:, :], lost))
        return ca.vertcat(state[:2], *currents, state[end:])
