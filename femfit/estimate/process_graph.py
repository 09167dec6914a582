"""A levitation process as expressions: all states one sample later, and what the sensors read."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import GraphFunction, Memo, building
from femfit.core.numerics import FloatArray
from femfit.estimate.delayed import DelayedSamples
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import PickupSensor
from femfit.model.sensing import AnySensor, pickup_flux, reading_expression
from femfit.model.sensors import sensor_named

MOST_EXACT = 10_000
"""Measured: instructions of a step above which its Jacobian takes seconds to make."""


@dataclass(frozen=True, eq=False)
class ProcessGraph:
    """States: those of the model, a bias of each sensor that has one, and samples that are remembered."""

    model: ActuatorModel
    biases: tuple[str, ...]
    delayed: DelayedSamples | None

    @property
    def order(self) -> int:
        """Number of states."""
        return self.model.order + len(self.biases) + (0 if self.delayed is None else self.delayed.order)

    @cached_property
    def light(self) -> bool:
        """Whether exact Jacobians, and a step as one function, are made in a second; else differences serve."""
        moved = self._known("moved", self.moved)
        return sum(tape.function.n_instructions() for tape, _ in moved.stages) <= MOST_EXACT

    def moved(self, x: SX, voltage: SX) -> SX:
        """All states one sample later; a body that a stop holds rests there."""
        model, end = self.model, self.model.order
        moving, biases = x[:end], ca.vertcat(SX(0, 1), *ca.vertsplit(x)[end : end + len(self.biases)])
        after = model.equations.step_of(moving, voltage, model.sample_time_s)
        near, far = model.require_motion().ends
        d, v = after[0], after[1]
        if np.isfinite(near):
            d, v = ca.fmax(after[0], near), ca.if_else(after[0] <= near, ca.fmax(v, 0.0), v)
        if np.isfinite(far):
            d, v = ca.fmin(d, far), ca.if_else(after[0] >= far, ca.fmin(v, 0.0), v)
        return ca.vertcat(d, v, *ca.vertsplit(after)[2:], biases, self._remembered(x))

    def begun(self, first: SX) -> SX:
        """All states of a body that was at rest before, from its distance, velocity and currents."""
        base = self.model.order + len(self.biases)
        known = ca.vertcat(first, SX.zeros(base - first.numel()))
        samples = () if self.delayed is None else self.delayed.by_sensor
        values = (ca.repmat(self._sampled(known, one.sensor), one.count) for one in samples)
        return ca.vertcat(known, *values)

    def read(self, x: SX, name: str) -> SX:
        """The reading of a sensor, its bias included."""
        samples = None if self.delayed is None else self.delayed.of_sensor(name)
        if samples is None:
            value = self._sampled(x, sensor_named(self.model, name))
        else:
            earlier = x[samples.first : samples.first + samples.count]
            value = ca.dot(ca.DM(samples.weights[1:]), earlier)
            if samples.weights[0]:
                value += samples.weights[0] * self._sampled(x, samples.sensor)
        return value + x[self.model.order + self.biases.index(name)] if name in self.biases else value

    def _sampled(self, x: SX, sensor: AnySensor) -> SX:
        """The g of :mod:`femfit.model.sensors`."""
        model, state = self.model, x[: self.model.order]
        if isinstance(sensor, PickupSensor):
            return pickup_flux(model, sensor, state)
        holding = SX(model.resistances_ohm) * ca.vertcat(SX(0, 1), *ca.vertsplit(state)[2 : 2 + len(model.circuits)])
        return reading_expression(model.equations, sensor, state, holding, SX(0.0))

    def _remembered(self, x: SX) -> SX:
        result = SX(0, 1)
        for samples in () if self.delayed is None else self.delayed.by_sensor:
            earlier = ca.vertsplit(x[samples.first : samples.first + samples.count])
            result = ca.vertcat(result, self._sampled(x, samples.sensor), *earlier[:-1])
        return result

    def transition(self, states: FloatArray, inputs: FloatArray) -> FloatArray:
        """States (N, n) one sample later."""
        return self._known("moved", self.moved)(states.T, self._volts(states, inputs)).T

    def transition_jacobian(self, states: FloatArray, inputs: FloatArray) -> FloatArray:
        """Jacobians of :meth:`transition`, (N, n, n)."""
        function = self._known("moved slope", lambda x, u: ca.vec(ca.jacobian(self.moved(x, u), x).T))
        return function(states.T, self._volts(states, inputs)).T.reshape(len(states), self.order, self.order)

    def measure(self, name: str, states: FloatArray) -> FloatArray:
        """Readings (N,) of a sensor in states (N, n)."""
        function = self._known(name, lambda x, _: self.read(x, name))
        return np.asarray(function(states.T, self._no_volts)[0])

    def gradient(self, name: str, states: FloatArray) -> FloatArray:
        """Gradients of :meth:`measure`, (N, n)."""
        function = self._known(name + " slope", lambda x, _: ca.gradient(self.read(x, name), x))
        return function(states.T, self._no_volts).T

    def _known(self, key: str, make: Callable[[SX, SX], SX]) -> GraphFunction:
        if key not in self._functions:
            with building():
                x, u = SX.sym("x", self.order), SX.sym("u", len(self.model.circuits))
                self._functions[key] = GraphFunction([x, u], make(x, u))
        return self._functions[key]

    @cached_property
    def _functions(self) -> dict[str, GraphFunction]:
        return Memo()

    @property
    def _no_volts(self) -> FloatArray:
        return np.zeros(len(self.model.circuits))

    def _volts(self, states: FloatArray, inputs: FloatArray) -> FloatArray:
        return np.asarray(inputs, dtype=np.float64).reshape(len(states), -1).T


def scalar_functions(
    graph: ProcessGraph, sensors: Sequence[str]
) -> tuple[ca.Function, ca.Function, ca.Function, ca.Function]:
    """(x, u) -> x+ and its Jacobian, x -> all readings and theirs, at a point."""
    with building():
        x, u = SX.sym("x", graph.order), SX.sym("u", len(graph.model.circuits))
        moved, read = graph.moved(x, u), ca.vertcat(*(graph.read(x, name) for name in sensors))
        parts = (moved, ca.vec(ca.jacobian(moved, x)), read, ca.vec(ca.jacobian(read, x)))
        step, step_slope, look, look_slope = (GraphFunction([x, u], part).at_a_point for part in parts)
    return step, step_slope, look, look_slope
