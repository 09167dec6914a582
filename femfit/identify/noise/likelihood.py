"""Variances of a campaign by restricted likelihood, with priors.

Of each channel c there are the squared length q_c of its readings beyond everything that was taken out of them, with
f_c degrees of freedom, and their coordinates t along the random effects (mounts, runs, stops of the stage). With T_k
the columns of those of variance v_k in the coordinates,

    t ~ N(0, S),   S = diag(s_c^2) + sum_k v_k T_k T_k'   (3 v^2 for columns of second order in a normal error),
    -2 log L = sum_c [f_c log s_c^2 + q_c / s_c^2] + log det S + t' S^-1 t - 2 log prior.

A variance x that was declared as a has the scaled inverse chi-square prior of w readings, w (log x + a / x); any other
one the half-Cauchy prior of its standard deviation about zero, 2 log(1 + x / a): what the readings cannot tell from
zero is zero, and what is really there is not made smaller. The maximum is found by Fisher scoring in log x.

References
----------
S. R. Searle, G. Casella and C. E. McCulloch, Variance Components (Wiley, 1992), section 6.6: restricted likelihood.
A. Gelman, Bayesian Analysis 1 (2006) 515: half-Cauchy priors of standard deviations.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.identify.constants import (
    FLAT,
    LARGEST_STEP,
    NO_VARIANCE,
    SEARCH_STEPS,
    SETTLED_STEP,
    VARIANCES_TRIED,
)


@dataclass(frozen=True, eq=False)
class Contrasts:
    """What the readings of one channel say once fixed effects are taken out of them."""

    square: float  # Squared length beyond the fixed and the random effects
    free: float  # Its degrees of freedom
    along: FloatArray  # Coordinates along the random effects, shape (k,)
    columns: FloatArray  # Of the random effects in them, shape (k, q)
    log_det: float = 0.0  # Of the readings' covariance over their variance, and of what was taken out


@dataclass(frozen=True, eq=False)
class Priors:
    """What is known of variances beforehand, each of shape (K + C,)."""

    scale: FloatArray
    weight: FloatArray  # Readings that a declared one counts like; 0 for none
    from_zero: BoolArray  # Whether the prior is half-Cauchy, and ``weight`` has no meaning

    def cost(self, x: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """-2 log of the prior at log variances x, its slope and its expected curvature."""
        ratio = np.exp(x) / self.scale
        heavy = np.sum(2.0 * np.log1p(ratio[self.from_zero]))
        chi = np.where(self.from_zero, 0.0, self.weight)
        slope = np.where(self.from_zero, 2.0 * ratio / (1.0 + ratio), chi * (1.0 - 1.0 / ratio))
        curvature = np.where(self.from_zero, 2.0 * ratio / (1.0 + ratio) ** 2, chi)
        return float(heavy + np.sum(chi * (np.log(ratio) + 1.0 / ratio - 1.0))), slope, curvature


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood of variances: first those of the random effects, then of the channels."""

    channels: Sequence[Contrasts]
    group: IntArray  # Number of the variance, 0 to K - 1, that each random effect's column has; shape (q,)
    second: BoolArray  # Whether its effect is the square of one of that variance; shape (q,)
    priors: Priors

    def maximum(self, *near: FloatArray) -> FloatArray:
        """Log variances (K + C,) where it is the largest; those that end far below their scale are none.

        It is sought from places near it; without any from where the priors are and from ten times as large standard
        deviations: a large effect may be given to another one at first.
        """
        scale = np.log(self.priors.scale)
        usual = [scale + factor * self.priors.from_zero for factor in (0.0, np.log(100.0))]
        ends = [self._climbed(start) for start in near or usual]
        return min(ends, key=self.cost)

    def _climbed(self, x: FloatArray) -> FloatArray:
        low, cost = np.log(self.priors.scale) + np.log(NO_VARIANCE), self.cost(x)
        for _ in range(SEARCH_STEPS):
            slope, curvature = self(x)
            free = (x > low + 1e-9) | (slope < 0.0)
            step = np.zeros(len(x))
            damped = curvature[np.ix_(free, free)] + FLAT * np.eye(int(free.sum()))
            size = np.sqrt(np.diag(damped))
            inner = damped / np.outer(size, size) + 1e-9 * np.eye(len(size))
            step[free] = np.clip(-np.linalg.solve(inner, slope[free] / size) / size, -LARGEST_STEP, LARGEST_STEP)
            for _ in range(SEARCH_STEPS):
                there = np.maximum(x + step, low)
                after = self.cost(there)
                if after <= cost + 1e-10 * abs(cost):
                    break
                step /= 2.0
            else:
                break
            moved = float(np.abs(there - x).max())
            x, cost = there, after
            if moved < SETTLED_STEP:
                break
        return x

    def mean_variance(self, x: FloatArray, k: int) -> float:
        """Posterior mean of the k-th variance, the others as they are: few mounts or runs say little of theirs."""
        largest = max(x[k], np.log(self.priors.scale[k])) + np.log(64.0**2)
        tried = np.linspace(largest - np.log(512.0**2), largest, VARIANCES_TRIED)
        costs = np.array([self.cost(np.array([*x[:k], value, *x[k + 1 :]])) for value in tried])
        density = np.exp(-0.5 * (costs - costs.min()) + 0.5 * (tried - largest))  # of it, over its logarithm
        return float(np.sum(density * np.exp(tried)) / np.sum(density))

    @cached_property
    def _stacked(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]:
        """Of all channels the coordinates (k,), columns (k, q), squares and freedom; the channel of each coordinate."""
        each = self.channels
        along, columns = np.concatenate([c.along for c in each]), np.concatenate([c.columns for c in each])
        square, free = np.array([c.square for c in each]), np.array([c.free for c in each])
        return along, columns, square, free, np.repeat(np.arange(len(each)), [len(c.along) for c in each])

    def _factor(self, variance: FloatArray) -> FloatArray:
        """L of L L' = S."""
        _, columns, _, _, channel = self._stacked
        count = len(variance) - len(self.channels)
        v = variance[:count][self.group]
        total = (columns * np.where(self.second, 3.0 * v**2, v)) @ columns.T
        total[np.diag_indices(len(total))] += variance[count:][channel]
        return np.asarray(np.linalg.cholesky(total), dtype=np.float64)

    def cost(self, x: FloatArray) -> float:
        """-2 log of likelihood and prior at log variances x."""
        along, _, square, free, _ = self._stacked
        lower, s = self._factor(np.exp(x)), np.exp(x[len(x) - len(self.channels) :])
        white = solve_triangular(lower, along, lower=True, check_finite=False)
        of_readings = free @ np.log(s) + np.sum(square / s)
        return float(of_readings + 2.0 * np.log(np.diag(lower)).sum() + white @ white + self.priors.cost(x)[0])

    def __call__(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Slope and expected curvature of the cost at log variances x."""
        along, columns, square, free, channel = self._stacked
        variance, count = np.exp(x), len(x) - len(self.channels)
        in_group = (self.group[:, None] == np.arange(count)).astype(np.float64)
        in_channel = (channel[:, None] == np.arange(len(self.channels))).astype(np.float64)
        s, change = variance[count:], np.where(self.second, 6.0 * variance[:count][self.group], 1.0)
        inverse = cho_solve((self._factor(variance), True), np.eye(len(along)), check_finite=False)
        a, solved = inverse @ along, inverse @ columns
        _, prior_slope, prior_curvature = self.priors.cost(x)
        of_effects = change * (np.sum(columns * solved, axis=0) - (columns.T @ a) ** 2)
        of_channels = in_channel.T @ (np.diag(inverse) - a**2) + free / s - square / s**2
        slope = np.concatenate([in_group.T @ of_effects, of_channels]) * variance + prior_slope
        effects = np.outer(change, change) * (columns.T @ solved) ** 2
        both = in_channel.T @ (solved**2 * change) @ in_group
        alone = in_channel.T @ inverse**2 @ in_channel + np.diag(free / s**2)
        curvature = np.block([[in_group.T @ effects @ in_group, both.T], [both, alone]])
        return slope, curvature * np.outer(variance, variance) + np.diag(prior_curvature)
