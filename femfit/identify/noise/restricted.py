"""Variance components by restricted maximum likelihood, with weak priors, from contrasts free of the fixed effects.

With y = X b + Z u + e, the restricted likelihood is that of contrasts of y that X does not reach. Of each channel
those are its squared length beyond X and Z, s^2 chi^2(f), and coordinates t along Z,

    t ~ N(0, S),   S = diag(s_c^2) + sum_k v_k T_k T_k'   (3 v^2 for columns of second order in a normal error),
    -2 log L = sum_c [f_c log s_c^2 + q_c / s_c^2] + log det S + t' S^-1 t + sum_j w_j (log x_j + a_j / x_j).

The last sum is the prior: each variance x_j is scaled inverse chi-square about a_j, which counts like w_j readings of
it. The minimum is found by Fisher scoring in log x; the information matrix gives the degrees of freedom of each
variance, 2 x^2 / var(x) (Satterthwaite).

References
----------
S. R. Searle, G. Casella and C. E. McCulloch, Variance Components (Wiley, 1992), chapters 6 and 8.
F. E. Satterthwaite, Biometrics Bulletin 2 (1946) 110: degrees of freedom of an estimated variance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.identify.constants import FLAT, LARGEST_STEP, NO_VARIANCE, SEARCH_STEPS, SETTLED_STEP


@dataclass(frozen=True, eq=False)
class Contrasts:
    """What the readings of one channel say once fixed effects are taken out of them."""

    square: float  # Squared length beyond the fixed and the random effects
    free: float  # Its degrees of freedom
    along: FloatArray  # Coordinates along the random effects, shape (k,)
    columns: FloatArray  # Of the random effects in them, shape (k, q)


@dataclass(frozen=True, eq=False)
class Components:
    """Variances of the random effects and then of the channels, shape (K + C,)."""

    variance: FloatArray
    # Variance of each, by the inverse of the information matrix, and where the others are known; shape (K + C,)
    spread: FloatArray
    spread_alone: FloatArray
    converged: bool

    @property
    def degrees_of_freedom(self) -> FloatArray:
        """Satterthwaite's degrees of freedom of each, the prior's included."""
        return np.asarray(2.0 * self.variance**2 / np.maximum(self.spread, 1e-300))


def restricted_estimate(
    channels: Sequence[Contrasts],
    group: IntArray,
    second: BoolArray,
    scale: FloatArray,
    weight: FloatArray,
    start: FloatArray | None = None,
) -> Components:
    """Maximise the restricted likelihood, prior included.

    Parameters
    ----------
    channels : sequence of Contrasts
        C of them.
    group : array, shape (q,)
        Number of the variance, 0 to K - 1, that each random effect's column has.
    second : array, shape (q,)
        Whether its effect is the square of one of that variance.
    scale, weight : arrays, shape (K + C,)
        Of the prior of each variance; a weight of 0 is none.
    start : array, shape (K + C,)
        Where the search starts; None for the prior's scale.
    """
    problem = _Problem(channels, group, second, scale, weight)
    low = np.log(scale) + np.log(NO_VARIANCE)
    x = np.log(scale if start is None else start)
    cost, slope, curvature = problem.at(x)
    for _ in range(SEARCH_STEPS):
        free = (x > low + 1e-9) | (slope < 0.0)
        step = np.zeros(len(x))
        damped = curvature[np.ix_(free, free)] + FLAT * np.eye(int(free.sum()))
        size = np.sqrt(np.diag(damped))
        inner = damped / np.outer(size, size) + 1e-9 * np.eye(len(size))
        step[free] = np.clip(-np.linalg.solve(inner, slope[free] / size) / size, -LARGEST_STEP, LARGEST_STEP)
        for _ in range(SEARCH_STEPS):
            there = np.maximum(x + step, low)
            after = problem.at(there)
            if after[0] <= cost + 1e-10 * abs(cost):
                break
            step /= 2.0
        else:
            return _components(x, low, curvature, converged=False)
        moved = float(np.abs(there - x).max())
        x, (cost, slope, curvature) = there, after
        if moved < SETTLED_STEP:
            return _components(x, low, curvature, converged=True)
    return _components(x, low, curvature, converged=False)


def _components(x: FloatArray, low: FloatArray, curvature: FloatArray, converged: bool) -> Components:
    """The curvature is that of -2 log L in log x, so that the variance of log x is twice its inverse.

    A variance at the lower end of the search is none, and its spread is that there.
    """
    variance = np.where(x > low + 1e-9, np.exp(x), 0.0)
    size = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    inverse = np.linalg.pinv(curvature / np.outer(size, size), rcond=1e-12, hermitian=True) / np.outer(size, size)
    squared = 2.0 * np.exp(2.0 * x)
    return Components(variance, squared * np.diag(inverse), squared / size**2, converged)


class _Problem:
    """The restricted likelihood of contrasts."""

    def __init__(
        self,
        channels: Sequence[Contrasts],
        group: IntArray,
        second: BoolArray,
        scale: FloatArray,
        weight: FloatArray,
    ) -> None:
        self.t = np.concatenate([one.along for one in channels])
        self.columns = np.concatenate([one.columns for one in channels])
        self.square = np.array([one.square for one in channels])
        self.free = np.array([one.free for one in channels])
        self.of = np.repeat(np.arange(len(channels)), [len(one.along) for one in channels])
        self.second, self.scale, self.weight = second, scale, weight
        self.effects = len(scale) - len(channels)
        self.group = group
        self.in_group = (group[:, None] == np.arange(self.effects)).astype(np.float64)
        self.in_channel = (self.of[:, None] == np.arange(len(channels))).astype(np.float64)

    def at(self, x: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """-2 log L, its slope and its expected curvature in log variances."""
        variance = np.exp(x)
        v, s = variance[: self.effects][self.group], variance[self.effects :]
        size, change = np.where(self.second, 3.0 * v**2, v), np.where(self.second, 6.0 * v, 1.0)
        total = (self.columns * size) @ self.columns.T
        total[np.diag_indices(len(total))] += s[self.of]
        lower = np.linalg.cholesky(total)
        root = solve_triangular(lower, np.eye(len(lower)), lower=True)
        inverse = root.T @ root
        a, seen = inverse @ self.t, inverse @ self.columns
        cost = float(
            self.free @ np.log(s)
            + np.sum(self.square / s)
            + 2.0 * np.log(np.diag(lower)).sum()
            + self.t @ a
            + np.sum(self.weight * (x - np.log(self.scale) + self.scale / variance - 1.0))
        )
        of_effects = change * (np.sum(self.columns * seen, axis=0) - (self.columns.T @ a) ** 2)
        of_channels = self.in_channel.T @ (np.diag(inverse) - a**2) + self.free / s - self.square / s**2
        slope = np.concatenate([self.in_group.T @ of_effects, of_channels]) * variance
        slope += self.weight * (1.0 - self.scale / variance)
        effects = np.outer(change, change) * (self.columns.T @ seen) ** 2
        both = self.in_channel.T @ (seen**2 * change) @ self.in_group
        channels = self.in_channel.T @ inverse**2 @ self.in_channel + np.diag(self.free / s**2)
        curvature = np.block([[self.in_group.T @ effects @ self.in_group, both.T], [both, channels]])
        curvature = curvature * np.outer(variance, variance) + np.diag(self.weight)
        return cost, slope, curvature
