"""A sample: steps of the equations, between the stops, beside freewheel diodes and current amplifiers.

A filter that runs, one that is exported, a record that is followed, a bound and a simulated plant all take these steps,
a filter one, two or four of them a sample.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import GraphFunction, of_variable, once
from femfit.core.numerics import BoolArray, FloatArray
from femfit.model.decay import eliminated
from femfit.model.drive import between, met_stops, regulated_current
from femfit.model.equations import Driver

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
            moved, apart = (np.square((finer - coarser)[1:last, judged]).sum(axis=1) for coarser in (states, ends))
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
        states = np.zeros((model.order, 2, 2, len(distance)))
        states[0], states[1] = distance, np.reshape([-speed, speed], (2, 1, 1))
        states[2 : 2 + n] = currents[:, :n].T[:, None, None]
        volts = np.broadcast_to(limits.T[:, None, :, None], (n, *states.shape[1:]))
        return states.reshape(model.order, -1), volts.reshape(n, -1)

    def _after(self, states: FloatArray, volts: FloatArray, count: int) -> tuple[FloatArray, BoolArray]:
        """States (order, N) a sample later by so many steps, and whether they stayed in the domain all the time."""
        box, last = self.model.validity, 2 + len(self.model.circuits)
        length, points = self.model.sample_time_s / count, states.shape[1]
        length_and_rest, within = np.tile([[length], [0.0], [1.0]], (1, points)), np.ones(points, dtype=np.bool_)
        for _ in range(count):
            states = self.model.equations.step(length)(states, volts, length_and_rest)
            within &= box.contains(states[0], states[2:last].T)
        return states, within

    def after(self, state: SX, command: SX, **options: bool) -> SX:
        """An expression's state one of :attr:`count` steps later, with the options of :meth:`step`."""
        return self.step(state, command, self.model.sample_time_s / self.count, **options)[0]

    def function(self, length: float, *, free: bool = True) -> GraphFunction:
        """(state, what the drivers are told) -> the parts of :meth:`step`, one below the other; made once."""
        x, u = SX.sym("x", self.model.order), SX.sym("u", len(self.model.circuits))
        return once(
            self,
            (length, free),
            lambda: GraphFunction([x, u], ca.vertcat(*self.step(x, u, length, driven=True, free=free))),
        )

    def step(self, state: SX, command: SX, length: float, *, driven: bool = False, free: bool = True) -> tuple[SX, SX]:
        """An expression's state a step in s later, and the distance that a body without stops would come to.

        Across a winding whose voltage is nought the freewheel diode has its drop while a current goes on.

        Parameters
        ----------
        driven : bool
            Whether commands are what the drivers are told, in V or A, instead of the voltages across the windings: a
            diode then keeps negative voltages away, and a current amplifier comes to its current with the step, or as
            near as its limits and its bandwidth allow.
        free : bool
            Whether the body follows its forces between its stops; else it goes on at its speed.
        """
        equations, motion = self.model.equations, self.model.require_motion()
        state = self.blocked(state)
        voltage, drivers = self._fed(command, state, length, driven)
        if not free:
            after = equations.step_at(state, voltage, length, 0.0, drivers=drivers)
            return self.blocked(after), after[0]
        state = ca.vertcat(between(state[0], motion.ends), state[1:])
        after = equations.step_at(state, voltage, length, stops=motion, drivers=drivers)
        distance, velocity = met_stops(motion, (state[0], state[1]), (after[0], after[1]), length)
        return self.blocked(ca.vertcat(distance, velocity, after[2:])), after[0]

    def _fed(self, command: SX, state: SX, length: float, driven: bool) -> tuple[SX, list[Driver]]:
        """Voltages across the windings, and the drivers that add to them."""
        result, drivers = SX(command), []
        for k, drop in self.model.diodes:
            result[k] = ca.fmax(command[k], 0.0) if driven else command[k]
            drivers.append(Driver(k, SX(0.0), (ca.if_else(result[k] == 0.0, -drop, 0.0), np.inf)))
        for k, circuit in enumerate(self.model.circuits):
            if driven and circuit.drive.kind == "current":
                result[k] = 0.0
                current = regulated_current(circuit, state[2 + k], command[k], length)
                limits = circuit.voltage_min_V, circuit.voltage_max_V
                drivers.append(Driver(k, current, limits))
        return result, drivers

    def blocked(self, state: SX) -> SX:
        """A state whose currents do not turn round where a diode feeds the winding; eddy currents keep their flux."""
        if not self.model.diodes:
            return state
        n, end = len(self.model.circuits), self.model.windings.end
        currents = [*ca.vertsplit(state[2:end])]
        for k, _ in self.model.diodes:
            currents[k] = ca.if_else(currents[k] < 0.0, 0.0, currents[k])
        if self.model.eddy is not None:
            coenergy = self.model.windings.magnetics.with_memory(self.model.equations.parts(state)[3])
            linked = of_variable(
                lambda x: ca.hessian(coenergy(x[0], x[1:]), x)[0][1:, 1 + n :], ca.vertcat(state[0], state[2:end])
            )
            lost = linked[:n, :].T @ (ca.vertcat(*currents[:n]) - state[2 : 2 + n])
            currents[n:] = ca.vertsplit(state[2 + n : end] - eliminated(linked[n:, :], lost))
        return ca.vertcat(state[:2], *currents, state[end:])
