"""The unscented Kalman filter that carries the covariance's factor instead of the covariance.

The predicted factor comes from a QR decomposition of the stacked deviations, the updated one from a rank-one change, so
that the covariance L L^T is positive semidefinite by construction and half the digits of P suffice.

References
----------
R. van der Merwe and E. A. Wan, The square-root unscented Kalman filter, Proc. ICASSP (2001) 3461.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import FilterError
from femfit.filters.cholesky import cholesky, rank_one_change
from femfit.filters.filter import Correction, Moments
from femfit.filters.filter_state import FilterState
from femfit.filters.sigma_points import SigmaPointFilter, deviations


@final
@dataclass(frozen=True, eq=False)
class SquareRootUnscentedFilter(SigmaPointFilter):
    """Square-root unscented Kalman filter: the same estimates as :class:`UnscentedFilter` up to rounding."""

    @cached_property
    def _noise_rows(self) -> FloatArray:
        """Transposed factor of Q, shape (n, n)."""
        factor, definite = cholesky(self.process.process_covariance[None])
        if not definite[0]:
            raise FilterError("The square-root filter needs a positive definite Q; give every state some noise.")
        return np.asarray(factor[0].T)

    def _predicted(self, state: FilterState, voltage: FloatArray) -> Moments:
        moved = self.propagated(state, voltage)
        delta, shift = deviations(moved, self.weight)
        dtype = moved.dtype.type
        noise = np.broadcast_to(self._noise_rows.astype(moved.dtype), (state.runs, *self._noise_rows.shape))
        rows = [dtype(np.sqrt(self.weight)) * delta.transpose(2, 1, 0), noise]
        scaled_shift = (dtype(np.sqrt(abs(self.shift_weight))) * shift).T
        if self.shift_weight >= 0.0:
            rows.append(scaled_shift[:, None, :])
        factor, definite = _triangular(np.concatenate(rows, axis=1))
        if self.shift_weight < 0.0:
            factor, reduced = rank_one_change(factor, scaled_shift, -1.0)
            definite &= reduced
        return _moments((moved[:, 0] + shift).T, factor, definite, None if self.redraw else moved)

    def _corrected(self, state: FilterState, measurement: FloatArray) -> Correction:
        predicted, variance, cross = self.output_moments(state)
        innovation = measurement - predicted
        mean = state.mean + (cross * (innovation / variance)).T
        factor, definite = rank_one_change(state.factor, (cross / np.sqrt(variance)).T, -1.0)
        return Correction(_moments(mean, factor, definite), innovation, variance)


def _triangular(rows: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Lower L with L L^T = A^T A for stacked rows A of shape (runs, m, n), its diagonal made positive."""
    upper: FloatArray = np.asarray(np.linalg.qr(rows, mode="r"))
    diagonal = np.einsum("rii->ri", upper)
    signs = np.where(diagonal < 0.0, -1.0, 1.0).astype(rows.dtype)
    return (upper * signs[:, :, None]).swapaxes(1, 2), np.all(diagonal != 0.0, axis=1)


def _moments(mean: FloatArray, factor: FloatArray, definite: BoolArray, points: FloatArray | None = None) -> Moments:
    return Moments(mean, np.matmul(factor, factor.swapaxes(1, 2)), factor, definite, points)
