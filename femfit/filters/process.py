"""What a filter is told of the world: x+ = f(x, u) + w, z = h(x) + n, with cov w = Q and var n = R."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.differences import central_differences

Transition = Callable[[FloatArray, FloatArray], FloatArray]
Measure = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class FilterProcess:
    """A discrete process with one input and one measurement, batched over N states.

    The input does not reach the measurement directly: z of a sample is taken before its u is applied.

    Parameters
    ----------
    names : tuple of str
        State names with units, for example ``distance_m``.
    transition : callable
        f: states (N, n) and inputs (N,) -> next states (N, n).
    measure : callable
        h: states (N, n) -> measurements (N,).
    process_covariance : array, shape (n, n)
        Q, added once a step.
    transition_jacobian : callable or None
        df/dx, shape (N, n, n); central differences where absent.
    measurement_jacobian : callable or None
        dh/dx, shape (N, n); central differences where absent.
    plausible : callable or None
        Mask (N,) of states that the model can still say something about.
    """

    names: tuple[str, ...]
    step_s: float
    transition: Transition
    measure: Measure
    process_covariance: FloatArray
    measurement_variance: float
    transition_jacobian: Transition | None = None
    measurement_jacobian: Measure | None = None
    plausible: Callable[[FloatArray], BoolArray] | None = None

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.names)

    def state_jacobian(self, states: FloatArray, inputs: FloatArray) -> FloatArray:
        """df/dx of shape (N, n, n), analytic where the process has it."""
        if self.transition_jacobian is not None:
            return self.transition_jacobian(states, inputs)
        return central_differences(lambda points: self.transition(points, np.tile(inputs, 2 * self.order)), states)

    def output_jacobian(self, states: FloatArray) -> FloatArray:
        """dh/dx of shape (N, n), analytic where the process has it."""
        if self.measurement_jacobian is not None:
            return self.measurement_jacobian(states)
        return central_differences(lambda points: self.measure(points)[:, None], states)[:, 0, :]
