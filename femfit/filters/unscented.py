"""The unscented Kalman filter with control input, the paper's (19) to (31).

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504.
S. J. Julier and J. K. Uhlmann, Proc. IEEE 92 (2004) 401.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.filters.filter import Correction, Moments, moments_of
from femfit.filters.filter_state import FilterState
from femfit.filters.sigma_points import SigmaPointFilter, deviations
from femfit.filters.single_step import single_step

DOUBLE = np.dtype(np.float64)


@final
@dataclass(frozen=True, eq=False)
class UnscentedFilter(SigmaPointFilter):
    """Unscented Kalman filter in difference form."""

    def _predicted(self, state: FilterState, voltage: FloatArray) -> Moments:
        moved = self.propagated(state, voltage)
        delta, shift = deviations(moved, self.weight)
        dtype = moved.dtype.type
        covariance = np.einsum("iar,jar->ijr", delta, delta)
        covariance *= dtype(self.weight)
        covariance += dtype(self.shift_weight) * (shift[:, None] * shift)
        covariance += self.process.process_covariance.astype(moved.dtype)[:, :, None]
        return moments_of((moved[:, 0] + shift).T, covariance.transpose(2, 0, 1), None if self.redraw else moved)

    def _corrected(self, state: FilterState, measurement: FloatArray) -> Correction:
        predicted, variance, cross = self.output_moments(state)
        innovation = measurement - predicted
        mean = state.mean + (cross * (innovation / variance)).T
        covariance = state.covariance - (cross[:, None] * cross / variance).transpose(2, 0, 1)
        return Correction(moments_of(mean, covariance), innovation, variance)

    def _step_alone(self, state: FilterState, voltage: float, measurement: float) -> FilterState | None:
        if not self.redraw or state.mean.dtype != DOUBLE:
            return None
        step = single_step(
            self.process, state.mean[0].tolist(), state.factor[0].tolist(), voltage, measurement, self._scaling
        )
        return None if step is None else self._next_alone(state, step)

    @cached_property
    def _scaling(self) -> tuple[float, float, float]:
        return self.spread, self.weight, self.shift_weight
