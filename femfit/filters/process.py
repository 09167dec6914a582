"""What a filter is told of the world: x+ = f(x, u) + w, z_k = h_k(x) + n_k, with cov w = Q and var n_k = R_k."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import isfinite

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.differences import central_differences
from femfit.core.errors import FilterError
from femfit.filters.delayed_samples import DelayedSamples

Transition = Callable[[FloatArray, FloatArray], FloatArray]
Measure = Callable[[FloatArray], FloatArray]
Columns = list[list[float]]


@dataclass(frozen=True, eq=False)
class Output:
    """One sensor of a process, whose noise is independent of the others'."""

    name: str
    unit: str
    measure: Measure  # h: states (N, n) -> measurements (N,)
    variance: float
    jacobian: Measure | None = None  # dh/dx, shape (N, n); central differences where absent
    # The reading of a handful of states in Python's floats, one list a state; by arrays where absent
    columns: Callable[[Columns], list[float]] | None = None
    period: int = 1  # Samples from one reading to the next; those between are missing

    def look(self, columns: Columns) -> list[float]:
        """The reading of a handful of states, given as one list a state."""
        if self.columns is not None:
            return self.columns(columns)
        result: list[float] = self.measure(np.array(columns).T).tolist()
        return result


@dataclass(frozen=True, eq=False)
class FilterProcess:
    """A discrete process with its inputs and the readings of one or more sensors, batched over N states.

    The input does not reach the measurement directly: z of a sample is taken before its u is applied.
    """

    names: tuple[str, ...]  # State names with units, for example ``distance_m``
    step_s: float
    transition: Transition  # f: states (N, n) and inputs (N,), or (N, inputs), -> next states (N, n)
    outputs: tuple[Output, ...]  # All sensors, in the order of a measurement's entries
    process_covariance: FloatArray  # Q, added once a step; shape (n, n)
    transition_jacobian: Transition | None = None  # df/dx, shape (N, n, n); central differences where absent
    # The same for a handful of states in Python's floats, one list a state, of a process with one input; else by arrays
    transition_columns: Callable[[Columns, float], Columns] | None = None
    # Range of states that the model can still say something about; shape (n,)
    lower: FloatArray | None = None
    upper: FloatArray | None = None
    start_covariance: FloatArray | None = None  # Covariance of a first estimate's error by default; shape (n, n)
    delayed: DelayedSamples | None = None  # States after the others that are values of earlier samples
    inputs: int = 1  # Voltages of a sample; of one alone, inputs have no axis of their own
    eddies: int = 0  # States that are eddy currents

    def predicting(self, transition: Transition, jacobian: Transition | None = None) -> "FilterProcess":
        """The same process with another transition of all states but those that are remembered, by arrays."""
        if self.delayed is None:
            return replace(self, transition=transition, transition_jacobian=jacobian, transition_columns=None)
        return replace(
            self,
            transition=partial(_with_samples, self.delayed, transition),
            transition_jacobian=None if jacobian is None else partial(_slope_with_samples, self.delayed, jacobian),
            transition_columns=None,
        )

    def plausible(self, states: FloatArray) -> BoolArray:
        """Which states of shape (N, n) the model can still say something about; NaN is not."""
        result = np.ones(len(states), dtype=np.bool_)
        for k, low, high in self._bounds:
            result &= (states[:, k] > low) & (states[:, k] < high)
        return result

    def move(self, columns: Columns, voltage: float | FloatArray) -> Columns:
        """The transition of a handful of states, given and returned as one list a state."""
        if self.transition_columns is not None and isinstance(voltage, float):
            return self.transition_columns(columns, voltage)
        inputs = np.full((len(columns[0]), *np.shape(voltage)), voltage)
        result: Columns = self.transition(np.array(columns).T, inputs).T.tolist()
        return result

    def is_plausible(self, state: list[float]) -> bool:
        """Whether one state is finite and plausible."""
        for k, low, high in self._bounds:
            if not low < state[k] < high:
                return False
        return isfinite(sum(state))

    @cached_property
    def noise_rows(self) -> list[list[float]]:
        """Rows of Q."""
        result: list[list[float]] = self.process_covariance.tolist()
        return result

    @cached_property
    def _bounds(self) -> list[tuple[int, float, float]]:
        """The states with a range, and the ranges."""
        if self.lower is None or self.upper is None:
            return []
        bounded = np.flatnonzero(np.isfinite(self.lower) | np.isfinite(self.upper))
        return [(int(k), float(self.lower[k]), float(self.upper[k])) for k in bounded]

    @cached_property
    def _deviations(self) -> FloatArray | None:
        """Standard deviations of a first estimate: over these the functions are linear enough for a filter."""
        if self.start_covariance is None:
            return None
        deviations = np.sqrt(np.diag(self.start_covariance))
        return deviations if np.all(deviations > 0.0) else None

    def require_start_covariance(self) -> FloatArray:
        """The covariance of a first estimate."""
        if self.start_covariance is None:
            raise FilterError("This process has no covariance for a first estimate; give start(mean, covariance).")
        return self.start_covariance

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.names)

    def state_jacobian(self, states: FloatArray, inputs: FloatArray) -> FloatArray:
        """df/dx of shape (N, n, n), analytic where the process has it."""
        if self.transition_jacobian is not None:
            return self.transition_jacobian(states, inputs)
        return central_differences(
            lambda points: self.transition(points, np.concatenate([inputs] * (2 * self.order))),
            states,
            self._deviations,
        )

    def output_jacobian(self, states: FloatArray, output: Output) -> FloatArray:
        """dh/dx of shape (N, n) of one sensor, analytic where it has it."""
        if output.jacobian is not None:
            return output.jacobian(states)
        measure = output.measure
        return central_differences(lambda points: measure(points)[:, None], states, self._deviations)[:, 0, :]


def _with_samples(
    delayed: DelayedSamples, transition: Transition, states: FloatArray, inputs: FloatArray
) -> FloatArray:
    return delayed.moved(transition(states[:, : delayed.base], inputs), states)


def _slope_with_samples(
    delayed: DelayedSamples, jacobian: Transition, states: FloatArray, inputs: FloatArray
) -> FloatArray:
    return delayed.jacobian(jacobian(states[:, : delayed.base], inputs), states)
