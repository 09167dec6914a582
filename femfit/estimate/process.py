"""What a filter is told of the world: x+ = f(x, u) + w, z_k = h_k(x) + n_k, with cov w = Q and var n_k = R_k.

States are those of the model, a bias of each sensor that has one, and for each sensor whose readings are late or are
differences g(x_(k-1)), g(x_(k-2)), .. of :mod:`femfit.model.sensors`: what it had at earlier samples. These move on by
one place a sample, and a reading is linear in them.

References
----------
B. D. O. Anderson and J. B. Moore, Optimal Filtering (Prentice-Hall, 1979), chapter 7: fixed-lag smoothing as filtering
of a state that earlier ones are added to.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cached_property, partial, reduce

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import GraphFunction, once
from femfit.core.numerics import BoolArray, FloatArray, central_differences
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import PickupSensor
from femfit.model.sensing import pickup_flux, reading_expression
from femfit.model.sensors import sensor_named, unit_in_name

MOST_EXACT = 10_000
"""Numerical: instructions of a step above which its Jacobian takes seconds to make."""


@dataclass(frozen=True)
class Output:
    """One sensor of a process, whose noise is independent of the others'."""

    name: str
    unit: str
    variance: float
    period: int = 1  # Samples from one reading to the next; those between are missing
    weights: tuple[float, ...] = (1.0,)  # c_0, c_1, .. of a reading
    first: int = 0  # Place of the first of its states

    @property
    def places(self) -> slice:
        """Of its states, one for each weight but the first."""
        return slice(self.first, self.first + len(self.weights) - 1)


@dataclass(frozen=True, eq=False)
class FilterProcess:
    """States, readings and noise of a model, batched over N states.

    The input does not reach the measurement directly: z of a sample is taken before its u is applied.
    """

    model: ActuatorModel
    biases: tuple[str, ...]
    outputs: tuple[Output, ...]  # All sensors, in the order of a measurement's entries
    process_covariance: FloatArray  # Q, added once a sample; shape (n, n)
    start_covariance: FloatArray  # Of a first estimate's error by default; shape (n, n)
    # Range of states that the model can still say something about; shape (n,)
    lower: FloatArray
    upper: FloatArray
    held: bool = False  # Whether the body stands still, whatever the forces say
    driven: bool = False  # Whether inputs are what drivers are told that are no bridges

    @property
    def inputs(self) -> int:
        """Commands of a sample, one a circuit."""
        return len(self.model.circuits)

    @property
    def base(self) -> int:
        """Number of states that are no samples."""
        return self.model.order + len(self.biases)

    @cached_property
    def order(self) -> int:
        """Number of all states."""
        return self.base + sum(len(output.weights) - 1 for output in self.outputs)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the states, with their units; a pickup coil's samples are flux linkages."""
        units = {output.name: unit_in_name(output.unit) for output in self.outputs}
        names = [*self.model.state_names, *(f"{name}_bias_{units[name]}" for name in self.biases)]
        for name, output in zip(units, self.outputs, strict=True):
            unit = "Wb" if isinstance(sensor_named(self.model, name), PickupSensor) else units[name]
            names += [f"{name}_before_{k}_{unit}" for k in range(1, len(output.weights))]
        return tuple(names)

    def plausible(self, states: FloatArray) -> BoolArray:
        """Which states of shape (N, n) the model can still say something about; NaN is not."""
        return np.asarray(((states > self.lower) & (states < self.upper)).all(axis=1))

    def is_plausible(self, state: list[float]) -> bool:
        """Whether one state is finite and plausible."""
        return all(low < value < high for value, (low, high) in zip(state, self._ranges, strict=True))

    @cached_property
    def _ranges(self) -> list[list[float]]:
        return np.stack([self.lower, self.upper], axis=1).tolist()

    @cached_property
    def light(self) -> bool:
        """Whether exact Jacobians, and a step as one function, are made in a second; else differences serve."""
        return self.step(first=True).operations <= MOST_EXACT

    @cached_property
    def steps(self) -> list[bool]:
        """Of each step in a sample whether it is the first, which remembers samples; all are where there are none."""
        return [True, *[self.order == self.base] * (self.model.sample_step.count - 1)]

    def step(self, *, first: bool, slopes: bool = False) -> GraphFunction:
        """:meth:`moved`, and below it df/dx column by column where slopes are wanted."""
        return self._function(("step", first), partial(self.moved, first=first), slopes=slopes)

    def reading(self, name: str, *, slopes: bool = False) -> GraphFunction:
        """The reading of a sensor, and below it its gradient where slopes are wanted."""
        return self._function(("reading", name), lambda x, _: self.read(x, name), slopes=slopes)

    def moved(self, x: SX, voltage: SX, *, first: bool = True) -> SX:
        """All states a step later."""
        end = self.model.order
        state = ca.vertcat(x[0], 0.0 if self.held else x[1], x[2:end])
        after = self.model.sample_step.after(state, voltage, driven=self.driven, free=not self.held)
        if not first:
            return ca.vertcat(after, x[end:])
        moved_on = [
            ca.vertcat(sampled(self.model, output.name, x), x[output.first : output.places.stop - 1])
            for output in self.outputs
            if len(output.weights) > 1
        ]
        return ca.vertcat(after, x[end : self.base], *moved_on)

    def read(self, x: SX, name: str) -> SX:
        """The reading of a sensor, its bias included."""
        output = next((output for output in self.outputs if output.name == name), None)
        now, *before = output.weights if output else (1.0,)  # of a sensor that is not read, what it has now
        value = now * sampled(self.model, name, x) if now else SX(0)
        if output and before:
            value += ca.dot(ca.DM(before), x[output.places])
        return value + x[self.model.order + self.biases.index(name)] if name in self.biases else value

    def begun(self, first: SX) -> SX:
        """All states of a body that was at rest before, from its first states, of which the last may be left out."""
        states = ca.vertcat(first, SX.zeros(self.base - first.numel()))
        samples = [(sampled(self.model, output.name, states), len(output.weights) - 1) for output in self.outputs]
        return ca.vertcat(states, *(ca.repmat(value, count) for value, count in samples if count))

    def first_estimate(self, first: FloatArray) -> FloatArray:
        """A first estimate (..., n) of a body that was at rest before; states that are left out at the end are zero."""
        missing = self.base - first.shape[-1] if first.ndim else 0
        if 0 < missing < self.base:
            first = np.concatenate([first, np.zeros((*first.shape[:-1], missing), first.dtype)], axis=-1)
        if self.order == self.base or first.shape[-1:] != (self.base,):
            return first
        begun = self._function("begun", lambda x, _: self.begun(x[: self.base]))
        padded = np.zeros((first.size // self.base, self.order))
        padded[:, : self.base] = first.reshape(-1, self.base)
        return self._values(begun, padded).reshape(*first.shape[:-1], self.order)

    def transition(self, states: FloatArray, inputs: FloatArray) -> FloatArray:
        """States (N, n) one sample later."""
        for first in self.steps:
            states = self._values(self.step(first=first), states, inputs)
        return states

    def with_slopes(self, states: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """States one sample later, (N, n), and df/dx, (N, n, n).

        The slopes are exact, or of a large graph differences over a first estimate's deviations.
        """
        if not self.light:
            repeated, steps = np.concatenate([inputs] * (2 * self.order)), np.sqrt(np.diag(self.start_covariance))
            differences = central_differences(lambda points: self.transition(points, repeated), states, steps)
            return self.transition(states, inputs), differences
        slopes: list[FloatArray] = []
        for first in self.steps:
            values = self._values(self.step(first=first, slopes=True), states, inputs)
            states, columns = np.split(values, [self.order], axis=1)
            slopes.append(columns.reshape(len(states), self.order, self.order).swapaxes(1, 2))
        return states, reduce(lambda before, slope: slope @ before, slopes)

    def measure(self, name: str, states: FloatArray) -> FloatArray:
        """Readings (N,) of a sensor in states (N, n)."""
        return self._values(self.reading(name), states)[:, 0]

    def gradient(self, name: str, states: FloatArray) -> FloatArray:
        """Gradients of :meth:`measure`, (N, n)."""
        return self._values(self.reading(name, slopes=True), states)[:, 1:]

    def _function(self, what: Hashable, make: Callable[[SX, SX], SX], *, slopes: bool = False) -> GraphFunction:
        """A function of all states and the circuits' voltages, made once."""

        def made() -> GraphFunction:
            x, u = SX.sym("x", self.order), SX.sym("u", self.inputs)
            value = make(x, u)
            return GraphFunction([x, u], ca.vertcat(value, ca.vec(ca.jacobian(value, x))) if slopes else value)

        return once(self, (what, slopes), made)

    def _values(self, function: GraphFunction, states: FloatArray, inputs: FloatArray | None = None) -> FloatArray:
        """Values (N, entries); without inputs where the function does not depend on them."""
        if inputs is None:
            return function(states.T, np.zeros(self.inputs)).T
        return function(states.T, np.asarray(inputs, dtype=np.float64).reshape(len(states), self.inputs).T).T


def sampled(model: ActuatorModel, name: str, x: SX) -> SX:
    """The g of a sensor of :mod:`femfit.model.sensors`, from states that begin with the model's."""
    sensor, state, end = sensor_named(model, name), x[: model.order], 2 + len(model.circuits)
    if isinstance(sensor, PickupSensor):
        return pickup_flux(model, sensor, state)
    holding = SX(model.resistances_ohm) * ca.vertcat(SX(0, 1), x[2:end])
    return reading_expression(model.equations, sensor, state, holding, SX(0.0))
