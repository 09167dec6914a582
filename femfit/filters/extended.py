"""The extended Kalman filter: the covariance follows the Jacobians of transition and measurement.

The Jacobians are analytic where the process has them (the levitation process does, from the model's own derivatives)
and central differences otherwise. The covariance is updated in Joseph's form, which keeps it positive definite.

References
----------
D. Simon, Optimal State Estimation (Wiley, 2006), sections 13.2 and 5.2.
"""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.filters.filter import Correction, Filter, Moments
from femfit.filters.filter_state import FilterState
from femfit.filters.process import Output


@final
@dataclass(frozen=True, eq=False, repr=False)
class ExtendedFilter(Filter):
    """Extended Kalman filter; parameters as in :class:`Filter`."""

    title: ClassVar[str] = "extended Kalman filter"

    def _predicted(self, state: FilterState, voltage: FloatArray) -> Moments:
        dtype = state.mean.dtype
        mean = self.process.transition(state.mean, voltage).astype(dtype, copy=False)
        jacobian = self.process.state_jacobian(state.mean, voltage).astype(dtype, copy=False)
        covariance = jacobian @ state.covariance @ jacobian.swapaxes(1, 2)
        return Moments(mean, covariance + self.process.process_covariance.astype(dtype, copy=False))

    def _corrected(self, state: FilterState, measurement: FloatArray, output: Output) -> Correction:
        dtype, noise = state.mean.dtype, output.variance
        predicted = output.measure(state.mean).astype(dtype, copy=False)
        slope = self.process.output_jacobian(state.mean, output).astype(dtype, copy=False)
        cross = np.einsum("rij,rj->ri", state.covariance, slope)
        variance = np.einsum("ri,ri->r", slope, cross) + noise
        gain = cross / variance[:, None]
        innovation = measurement - predicted
        mean = state.mean + gain * innovation[:, None]
        kept = np.eye(self.process.order, dtype=dtype) - gain[:, :, None] * slope[:, None, :]
        covariance = kept @ state.covariance @ kept.swapaxes(1, 2) + noise * gain[:, :, None] * gain[:, None, :]
        return Correction(Moments(mean, 0.5 * (covariance + covariance.swapaxes(1, 2))), innovation, variance)
