"""Variances of a campaign by restricted likelihood, with priors.

Of each channel c there are the squared length q_c of its readings beyond everything that was taken out of them, with
f_c degrees of freedom, and their coordinates t along the random effects (mounts, runs, stops of the stage). With T_k
the columns of those of variance v_k in the coordinates,

    t ~ N(0, S),   S = diag(s_c^2) + sum_k v_k T_k T_k'   (2 v^2 for columns of second order in a normal error),
    -2 log L = sum_c [f_c log s_c^2 + q_c / s_c^2] + log det S + t' S^-1 t - 2 log prior.

What all mounts share of a column of second order is taken out. A variance x that was declared as a has the scaled
inverse chi-square prior of w readings, w (log x + a / x); that of a random effect otherwise the half-Cauchy prior of
its standard deviation about zero, 2 log(1 + x / a): what the readings cannot tell from zero is zero, and what is really
there is not made smaller. That of a channel without a declaration is even in its logarithm. The maximum is found by
Fisher scoring in log x.

References
----------
S. R. Searle, G. Casella and C. E. McCulloch, Variance Components (Wiley, 1992), section 6.6: restricted likelihood.
A. Gelman, Bayesian Analysis 1 (2006) 515: half-Cauchy priors of standard deviations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve

from femfit.core.numerics import BoolArray, FloatArray, IntArray, root_beside_one
from femfit.identify.constants import LARGEST_UNSEEN

VARIANCES_TRIED = 37
"""Numerical: values over which a variance is averaged, even in its logarithm, from 512 times below the largest
standard deviation."""

SEARCH_STEPS, LARGEST_STEP, SETTLED_STEP, NO_VARIANCE = 100, 2.0, 1e-5, 1e-6
"""Numerical: steps of the search for variances, the largest and the last in a log variance, and the part of its scale
below which a variance is none."""

FLAT = 1e-6
"""Numerical: curvature of -2 log likelihood in a log variance below which it is flat, and the variance stays."""


@dataclass(frozen=True, eq=False)
class Contrasts:
    """What the readings of one channel say once fixed effects are taken out of them."""

    square: float  # Squared length beyond the fixed and the random effects
    free: float  # Its degrees of freedom
    along: FloatArray  # Coordinates along the random effects, shape (k,)
    columns: FloatArray  # Of the random effects in them, shape (k, q)
    log_det: float = 0.0  # Of the readings' covariance over their variance, and of what was taken out


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood of variances: first those of the random effects, then of the channels."""

    channels: Sequence[Contrasts]
    group: IntArray  # Number of the variance, 0 to K - 1, that each random effect's column has; shape (q,)
    second: BoolArray  # Whether its effect is the square of one of that variance; shape (q,)
    # Known beforehand of each variance; shape (K + C,)
    scale: FloatArray
    weight: FloatArray  # Readings that a declared one counts like; 0 for none
    from_zero: BoolArray  # Whether the prior is half-Cauchy, and ``weight`` has no meaning

    def maximum(self, *near: FloatArray) -> FloatArray:
        """Log variances (K + C,) where it is the largest; those that end far below their scale are none.

        It is sought from places near it; without any from where the priors are and from ten times as large standard
        deviations: a large effect may be given to another one at first.
        """
        scale = np.log(self.scale)
        usual = [scale + factor * self.from_zero for factor in (0.0, np.log(100.0))]
        return min((self._climbed(start) for start in near or usual), key=self.cost)

    def _climbed(self, x: FloatArray) -> FloatArray:
        low, cost = np.log(self.scale) + np.log(NO_VARIANCE), self.cost(x)
        for _ in range(SEARCH_STEPS):
            slope, curvature = self(x)
            free = (x > low + 1e-9) | (slope < 0.0)
            step = np.zeros(len(x))
            damped = curvature[np.ix_(free, free)] + FLAT * np.eye(int(free.sum()))
            size = np.sqrt(np.diag(damped))
            inner = damped / np.outer(size, size) + 1e-9 * np.eye(len(size))
            step[free] = np.clip(-np.linalg.solve(inner, slope[free] / size) / size, -LARGEST_STEP, LARGEST_STEP)
            for _ in range(SEARCH_STEPS):
                tried = np.maximum(x + step, low)
                after = self.cost(tried)
                if after <= cost + 1e-10 * abs(cost):
                    break
                step /= 2.0
            else:
                break
            moved = float(np.abs(tried - x).max())
            x, cost = tried, after
            if moved < SETTLED_STEP:
                break
        return x

    def mean_variance(self, x: FloatArray, k: int) -> float:
        """Posterior mean of the k-th variance, the others as they are: few mounts or runs say little of theirs.

        Up to a largest one, without which a half-Cauchy prior has no mean where the readings say next to nothing. Of a
        declared one the likeliest: it stands where the readings say nothing.
        """
        if not self.from_zero[k]:
            return float(np.exp(x[k]))
        largest = max(x[k], np.log(self.scale[k])) + 2.0 * np.log(LARGEST_UNSEEN)
        tried = np.linspace(largest - np.log(512.0**2), largest, VARIANCES_TRIED)
        costs = np.array([self.cost(np.array([*x[:k], value, *x[k + 1 :]])) for value in tried])
        density = np.exp(-0.5 * (costs - costs.min()) + 0.5 * (tried - largest))  # of it, over its logarithm
        return float(np.sum(density * np.exp(tried)) / np.sum(density))

    @cached_property
    def _products(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Per channel T'T, shape (C, q, q), T't, (C, q), its squared length and its degrees of freedom, (C,)."""
        each = self.channels
        gram, along = np.array([c.columns.T @ c.columns for c in each]), np.array([c.columns.T @ c.along for c in each])
        square = np.array([c.square + c.along @ c.along for c in each])
        return gram, along, square, np.array([c.free + len(c.along) for c in each])

    def _solved(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """M = sum of T'T / s_c^2, its vector of T't / s_c^2, R = (D^-1 + M)^-1 with D = diag(v_k), log det (D R^-1).

        By the inverse of a sum (Woodbury) S^-1 = N^-1 - N^-1 T R T' N^-1, N = diag(s_c^2): all is of the size of the
        random effects, however many coordinates the channels have.
        """
        gram, along, *_ = self._products
        count = len(x) - len(self.channels)
        v, precision = np.exp(x[:count])[self.group], np.exp(-x[count:])
        root = np.sqrt(np.where(self.second, 2.0 * v**2, v))
        total, vector = np.tensordot(precision, gram, 1), precision @ along
        lower = root_beside_one(root[:, None] * total * root)
        inverse = root[:, None] * cho_solve((lower, True), np.diag(root), check_finite=False)
        return total, vector, inverse, 2.0 * float(np.log(np.diag(lower)).sum())

    def _prior(self, x: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """-2 log of the prior at log variances x, its slope and its expected curvature."""
        ratio, counted = np.exp(x) / self.scale, np.where(self.from_zero, 0.0, self.weight)
        cost = np.sum(2.0 * self.from_zero * np.log1p(ratio) + counted * (np.log(ratio) + 1.0 / ratio - 1.0))
        slope = np.where(self.from_zero, 2.0 * ratio / (1.0 + ratio), counted * (1.0 - 1.0 / ratio))
        return float(cost), slope, np.where(self.from_zero, 2.0 * ratio / (1.0 + ratio) ** 2, counted)

    def cost(self, x: FloatArray) -> float:
        """-2 log of likelihood and prior at log variances x."""
        _, _, square, free = self._products
        _, vector, inverse, log_det = self._solved(x)
        of_channels = x[len(x) - len(self.channels) :]
        of_readings = free @ of_channels + square @ np.exp(-of_channels)
        return float(of_readings + log_det - vector @ inverse @ vector + self._prior(x)[0])

    def __call__(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Slope and expected curvature of the cost at log variances x."""
        gram, along, square, free = self._products
        total, vector, inverse, _ = self._solved(x)
        count, variance = len(x) - len(self.channels), np.exp(x)
        in_group = (self.group[:, None] == np.arange(count)).astype(np.float64)
        precision, change = 1.0 / variance[count:], np.where(self.second, 4.0 * variance[:count][self.group], 1.0)
        mean = inverse @ vector
        beyond = np.eye(len(total)) - inverse @ total  # T' S^-1 T = M (1 - R M), and T' S^-1 t likewise
        inner, outer = total @ beyond, vector - total @ mean
        spread = gram @ inverse  # of each channel
        trace = np.trace(spread, axis1=1, axis2=2)
        remaining = square - 2.0 * along @ mean + np.einsum("i,cij,j->c", mean, gram, mean)
        of_effects = change * (np.diag(inner) - outer**2)
        of_channels = free * precision - precision**2 * (trace + remaining)
        _, prior_slope, prior_curvature = self._prior(x)
        slope = np.concatenate([in_group.T @ of_effects, of_channels]) * variance + prior_slope
        effects = in_group.T @ (np.outer(change, change) * inner**2) @ in_group
        squares = np.sum(beyond * (gram @ beyond), axis=1)  # of T beyond R M, column by column
        both = precision[:, None] ** 2 * (squares * change) @ in_group
        alone = np.einsum("cij,dji->cd", spread, spread) * np.outer(precision, precision) ** 2
        alone += np.diag(free * precision**2 - 2.0 * trace * precision**3)
        curvature = np.block([[effects, both.T], [both, alone]])
        return slope, curvature * np.outer(variance, variance) + np.diag(prior_curvature)
