"""What a filter is told of the world: x+ = f(x, u) + w, z_k = h_k(x) + n_k, with cov w = Q and var n_k = R_k.

The state of a batch of filters, which one step hands to the next, and how a run ended.

Cholesky factors of many small matrices, each reporting its own failure.

``numpy.linalg.cholesky`` raises for the whole batch when one matrix fails; a Monte-Carlo run must name the run.
Entry by entry over all runs at once, it is also several times faster for many small matrices; a few large ones go to it
first.
"""

from contextlib import suppress
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cached_property
from math import isfinite

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray, central_differences
from femfit.estimate.process_graph import ProcessGraph
from femfit.estimate.words import sentence


@dataclass(frozen=True)
class Output:
    """One sensor of a process, whose noise is independent of the others'."""

    name: str
    unit: str
    variance: float
    period: int = 1  # Samples from one reading to the next; those between are missing


@dataclass(frozen=True, eq=False, kw_only=True)
class FilterProcess(ProcessGraph):
    """A graph with its noise, its first estimate and the states that it holds for, batched over N states.

    The input does not reach the measurement directly: z of a sample is taken before its u is applied.
    """

    outputs: tuple[Output, ...]  # All sensors, in the order of a measurement's entries
    process_covariance: FloatArray  # Q, added once a sample; shape (n, n)
    start_covariance: FloatArray  # Of a first estimate's error by default; shape (n, n)
    # Range of states that the model can still say something about; shape (n,)
    lower: FloatArray
    upper: FloatArray

    @property
    def inputs(self) -> int:
        """Commands of a sample, one a circuit."""
        return len(self.model.circuits)

    def plausible(self, states: FloatArray) -> BoolArray:
        """Which states of shape (N, n) the model can still say something about; NaN is not."""
        result = np.ones(len(states), dtype=np.bool_)
        for k, low, high in self._bounds:
            result &= (states[:, k] > low) & (states[:, k] < high)
        return result

    def is_plausible(self, state: list[float]) -> bool:
        """Whether one state is finite and plausible."""
        for k, low, high in self._bounds:
            if not low < state[k] < high:
                return False
        return isfinite(sum(state))

    @cached_property
    def _bounds(self) -> list[tuple[int, float, float]]:
        """The states with a range, and the ranges."""
        bounded = np.flatnonzero(np.isfinite(self.lower) | np.isfinite(self.upper))
        return [(int(k), float(self.lower[k]), float(self.upper[k])) for k in bounded]

    def first_estimate(self, first: FloatArray) -> FloatArray:
        """A first estimate (..., n) of a body that was at rest before; states that are left out at the end are zero."""
        missing = self.base - first.shape[-1] if first.ndim else 0
        if 0 < missing < self.base:
            first = np.concatenate([first, np.zeros((*first.shape[:-1], missing), first.dtype)], axis=-1)
        if not self.samples or first.shape[-1:] != (self.base,):
            return first
        begun = self.function("begun", lambda x, _: self.begun(x), self.base)
        return self._values(begun, first.reshape(-1, self.base)).reshape(*first.shape[:-1], self.order)

    def with_slopes(self, states: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """States one sample later, (N, n), and df/dx, (N, n, n).

        The slopes are exact, or of a large graph differences over a first estimate's deviations.
        """
        if self.light:
            return self.transition_with_slopes(states, inputs)
        return self.transition(states, inputs), central_differences(
            lambda points: self.transition(points, np.concatenate([inputs] * (2 * self.order))),
            states,
            np.sqrt(np.diag(self.start_covariance)),
        )


class FilterOutcome(IntEnum):
    """How a run ended; the first outcome other than RUNNING stays."""

    RUNNING = 0
    COVARIANCE_LOST = 1
    NOT_FINITE = 2
    LEFT_MODEL = 3
    INNOVATIONS_OUT_OF_BAND = 4

    @property
    def sentence(self) -> str:
        """What happened and what to do about it."""
        return sentence("filter", "outcome", self.name)


@dataclass(frozen=True, eq=False)
class FilterState:
    """Estimates of many runs; never changed, every step returns a new one."""

    mean: FloatArray  # Estimated state; NaN from the step at which a run broke down numerically; shape (runs, n)
    # Covariance of the estimate's error, and its lower Cholesky factor; shape (runs, n, n)
    covariance: FloatArray
    factor: FloatArray
    # Measurement minus its prediction at the last update, and its expected square; NaN before the first
    # shape (runs,), and (runs, sensors) where there are several; NaN for a sample that is missing
    innovation: FloatArray
    innovation_variance: FloatArray
    out_of_band: FloatArray  # Recent fraction of innovations outside of their band; shape (runs,)
    outcome: IntArray  # A :class:`FilterOutcome` each; shape (runs,)

    def of_runs(self, which: IntArray | BoolArray) -> "FilterState":
        """Some of the runs."""
        return FilterState(*(getattr(self, array.name)[which] for array in fields(self)))

    def with_runs(self, which: IntArray | BoolArray, changed: "FilterState") -> "FilterState":
        """The same with other states of some runs; innovations of more sensors than before are unknown for the rest."""
        result = []
        for array in fields(self):
            old, new = getattr(self, array.name), getattr(changed, array.name)
            values = np.array(old) if old.shape[1:] == new.shape[1:] else np.full((len(old), *new.shape[1:]), np.nan)
            values[which] = new
            result.append(values)
        return FilterState(*result)

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.mean)

    @property
    def diverged(self) -> BoolArray:
        """Which runs have an outcome other than RUNNING."""
        return np.asarray(self.outcome != 0)

    @property
    def normalised_innovation_squared(self) -> FloatArray:
        """Innovation^2 over its variance, shape (runs,).

        In a true filter it is chi-square with one degree of freedom for each sensor that was read; NaN where all
        samples are missing.
        """
        ratio = self.innovation**2 / self.innovation_variance
        if ratio.ndim == 1:
            return np.asarray(ratio)
        read = np.isfinite(ratio)
        return np.where(read.any(axis=1), np.where(read, ratio, 0.0).sum(axis=1), np.nan)

    def outcomes(self) -> tuple[FilterOutcome, ...]:
        """The outcome of every run."""
        return tuple(FilterOutcome(int(code)) for code in self.outcome)


def cholesky(matrices: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Lower factors L with L L^T = M.

    Parameters
    ----------
    matrices : array, shape (runs, n, n)
        Symmetric; only the lower triangle is read.

    Returns
    -------
    factor : array, shape (runs, n, n)
        NaN where the matrix is not positive definite.

    References
    ----------
    G. H. Golub and C. F. Van Loan, Matrix Computations (Johns Hopkins, 2013), section 4.2.5.
    """
    runs, order, _ = matrices.shape
    if runs < order**3:
        with suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.cholesky(matrices), np.float64), np.ones(runs, dtype=np.bool_)
    factor = np.zeros((order, order, runs))  # each entry's values of all runs are neighbours
    with np.errstate(invalid="ignore", divide="ignore", over="ignore", under="ignore"):
        for j in range(order):
            pivot = matrices[:, j, j]
            for k in range(j):
                pivot = pivot - factor[j, k] ** 2
            root = np.sqrt(pivot, out=factor[j, j])
            for i in range(j + 1, order):
                entry = matrices[:, i, j]
                for k in range(j):
                    entry = entry - factor[i, k] * factor[j, k]
                np.divide(entry, root, out=factor[i, j])
        definite = factor[-1, -1] > 0.0  # a pivot that is not positive makes all later ones NaN
    factor = factor.transpose(2, 0, 1)
    if not definite.all():
        factor[~definite] = np.nan
    return factor, definite
