"""A levitation process as expressions: all states one sample later, and what the sensors read.

Behind the states of the model and the biases stand, for each sensor whose readings are late or are differences,
g(x_(k-1)), g(x_(k-2)), .. of :mod:`femfit.model.sensors`: what it had at earlier samples. They move on by one place a
sample, and a reading is linear in them.

References
----------
B. D. O. Anderson and J. B. Moore, Optimal Filtering (Prentice-Hall, 1979), chapter 7: fixed-lag smoothing as filtering
of a state that earlier ones are added to.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.errors import FilterError
from femfit.core.graph import GraphFunction, once
from femfit.core.numerics import FloatArray
from femfit.estimate.constants import MOST_DELAYED_SAMPLES
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import PickupSensor
from femfit.model.sensing import AnySensor, pickup_flux, reading_expression
from femfit.model.sensors import reading_of, sample_weights, sensor_named, unit_in_name

MOST_EXACT = 10_000
"""Measured: instructions of a step above which its Jacobian takes seconds to make."""


@dataclass(frozen=True, eq=False)
class SensorSamples:
    """What is remembered of one sensor."""

    name: str
    sensor: AnySensor
    places: slice  # Of its states
    weights: FloatArray  # c_0, c_1, .. of a reading

    @property
    def count(self) -> int:
        """States of this sensor."""
        return len(self.weights) - 1


def process_graph(model: ActuatorModel, sensors: Sequence[str], biases: Sequence[str]) -> "ProcessGraph":
    """The graph of a model that these sensors read, of which some have a bias.

    Raises
    ------
    FilterError
        If a delay is longer than a filter remembers.
    """
    samples, end = [], model.order + len(biases)
    for name in sensors:
        sensor = sensor_named(model, name)
        if sensor.delay_s > MOST_DELAYED_SAMPLES * model.sample_time_s:
            raise FilterError(
                f"A filter remembers {MOST_DELAYED_SAMPLES} samples at most; sensor {name!r} is late by "
                f"{1e3 * sensor.delay_s:g} ms, which are {sensor.delay_s / model.sample_time_s:.0f}. Lengthen the "
                "sample time, or leave the sensor out."
            )
        weights = sample_weights(sensor, model.sample_time_s)
        if len(weights) > 1:
            samples.append(SensorSamples(name, sensor, slice(end, end + len(weights) - 1), weights))
            end = samples[-1].places.stop
    return ProcessGraph(model, tuple(biases), tuple(samples))


@dataclass(frozen=True, eq=False)
class ProcessGraph:
    """States: those of the model, a bias of each sensor that has one, and samples that are remembered."""

    model: ActuatorModel
    biases: tuple[str, ...]
    samples: tuple[SensorSamples, ...]
    held: bool = False  # Whether the body stands still, whatever the forces say
    driven: bool = False  # Whether inputs are what drivers are told that are no bridges

    @property
    def base(self) -> int:
        """Number of states that are no samples."""
        return self.model.order + len(self.biases)

    @property
    def order(self) -> int:
        """Number of all states."""
        return self.base + sum(samples.count for samples in self.samples)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the states, with their units; a pickup coil's samples are flux linkages."""
        units = {name: unit_in_name(reading_of(self.model, name).unit) for name in self.biases}
        names = [*self.model.state_names, *(f"{name}_bias_{unit}" for name, unit in units.items())]
        for samples in self.samples:
            unit = unit_in_name(reading_of(self.model, samples.name).unit)
            unit = "Wb" if isinstance(samples.sensor, PickupSensor) else unit
            names += [f"{samples.name}_before_{k + 1}_{unit}" for k in range(samples.count)]
        return tuple(names)

    @cached_property
    def light(self) -> bool:
        """Whether exact Jacobians, and a step as one function, are made in a second; else differences serve."""
        return self.function("moved", self.moved).operations <= MOST_EXACT

    @property
    def steps(self) -> list[tuple[GraphFunction, Callable[[], GraphFunction]]]:
        """The steps of a sample, of which the first remembers samples, and what makes each with its slopes below it."""
        first = self._step_named("moved", self.moved)
        later = self._step_named("moved on", self.moved_on) if self.samples else first
        return [first, *[later] * (self.model.sample_step.count - 1)]

    def _step_named(self, name: str, make: Callable[[SX, SX], SX]) -> tuple[GraphFunction, Callable[[], GraphFunction]]:
        def with_slope(x: SX, voltage: SX) -> SX:
            after = make(x, voltage)
            return ca.vertcat(after, ca.vec(ca.jacobian(after, x)))

        return self.function(name, make), lambda: self.function(f"{name} with slope", with_slope)

    def moved(self, x: SX, voltage: SX) -> SX:
        """All states the first step of a sample later; so of that which remembers samples."""
        return ca.vertcat(self.moved_on(x, voltage)[: self.base], self.remembered(x))

    def moved_on(self, x: SX, voltage: SX) -> SX:
        """All states a further step of the sample later."""
        end = self.model.order
        state = ca.vertcat(x[0], 0.0 if self.held else x[1], x[2:end])
        after = self.model.sample_step.after(state, voltage, driven=self.driven, free=not self.held)
        return ca.vertcat(after, x[end:])

    def begun(self, first: SX) -> SX:
        """All states of a body that was at rest before, from its first states, of which the last may be left out."""
        known = ca.vertcat(first, SX.zeros(self.base - first.numel()))
        return ca.vertcat(known, *(ca.repmat(self._sampled(known, of.sensor), of.count) for of in self.samples))

    def read(self, x: SX, name: str) -> SX:
        """The reading of a sensor, its bias included."""
        samples = next((samples for samples in self.samples if samples.name == name), None)
        if samples is None:
            value = self._sampled(x, sensor_named(self.model, name))
        else:
            value = ca.dot(ca.DM(samples.weights[1:]), x[samples.places])
            if samples.weights[0]:
                value += samples.weights[0] * self._sampled(x, samples.sensor)
        return value + x[self.model.order + self.biases.index(name)] if name in self.biases else value

    def remembered(self, x: SX) -> SX:
        """The states that are samples, one sample later."""
        result = SX(0, 1)
        for samples in self.samples:
            earlier = ca.vertsplit(x[samples.places])
            result = ca.vertcat(result, self._sampled(x, samples.sensor), *earlier[:-1])
        return result

    def _sampled(self, x: SX, sensor: AnySensor) -> SX:
        """The g of :mod:`femfit.model.sensors`."""
        model, state = self.model, x[: self.model.order]
        if isinstance(sensor, PickupSensor):
            return pickup_flux(model, sensor, state)
        holding = SX(model.resistances_ohm) * ca.vertcat(SX(0, 1), *ca.vertsplit(state)[2 : 2 + len(model.circuits)])
        return reading_expression(model.equations, sensor, state, holding, SX(0.0))

    def transition(self, states: FloatArray, inputs: FloatArray) -> FloatArray:
        """States (N, n) one sample later."""
        for step, _ in self.steps:
            states = self._values(step, states, inputs)
        return states

    def transition_with_slopes(self, states: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """:meth:`transition` and its Jacobians, (N, n, n)."""
        result: FloatArray | None = None
        for _, with_slope in self.steps:
            states, columns = np.split(self._values(with_slope(), states, inputs), [self.order], axis=1)
            slopes = columns.reshape(len(states), self.order, self.order).swapaxes(1, 2)
            result = slopes if result is None else slopes @ result
        assert result is not None  # noqa: S101  a sample has a step
        return states, result

    def measure(self, name: str, states: FloatArray) -> FloatArray:
        """Readings (N,) of a sensor in states (N, n)."""
        return self._values(self.reading(name), states)[:, 0]

    def gradient(self, name: str, states: FloatArray) -> FloatArray:
        """Gradients of :meth:`measure`, (N, n)."""
        return self._values(self.reading_slope(name), states)

    def reading(self, name: str) -> GraphFunction:
        """The reading of a sensor."""
        return self.function(("reading", name), lambda x, _: self.read(x, name))

    def reading_slope(self, name: str) -> GraphFunction:
        """Its gradient."""
        return self.function(("slope", name), lambda x, _: ca.gradient(self.read(x, name), x))

    def sample_spreads(self, states: FloatArray, deviations: FloatArray) -> list[float]:
        """The largest deviation of each remembered sample over states (N, base) that are so uncertain."""
        result = []
        for samples in self.samples:

            def slope(x: SX, _: SX, sensor: AnySensor = samples.sensor) -> SX:
                return ca.gradient(self._sampled(x, sensor), x)

            slopes = self._values(self.function(("sampled", samples.name), slope, self.base), states)
            result += [float((np.abs(slopes) @ deviations).max())] * samples.count
        return result

    def function(
        self, what: str | tuple[str, str], make: Callable[[SX, SX], SX], states: int | None = None
    ) -> GraphFunction:
        """A function of so many states, or all, and the circuits' voltages, made once."""

        def made() -> GraphFunction:
            x, u = SX.sym("x", self.order if states is None else states), SX.sym("u", len(self.model.circuits))
            return GraphFunction([x, u], make(x, u))

        return once(self, what, made)

    def _values(self, function: GraphFunction, states: FloatArray, inputs: FloatArray | None = None) -> FloatArray:
        """Values (N, entries); without inputs where the function does not depend on them."""
        if inputs is None:
            return function(states.T, np.zeros(len(self.model.circuits))).T
        volts = np.asarray(inputs, dtype=np.float64).reshape(len(states), len(self.model.circuits))
        return function(states.T, volts.T).T
