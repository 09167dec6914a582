"""Contrasts of one channel that hold its noise alone: free of everything that settings, and a hidden effect, may do.

Where a channel has repeats, each setting has a mean of its own (``cells``), so that only the differences between
repeats are left. Where it has not, smooth patterns are taken out instead. Temperatures and times are taken out besides,
and what an error of the distance that all mounts share would do.

Successive readings of a run are whitened by W, (y_i - r y_(i-1)) / sqrt(1 - r^2) with r = rho^gap, so that all of it is
least squares with the products X' W' W X.

From them follow variance components by restricted maximum likelihood, with weak priors. With y = X b + Z u + e, the
restricted likelihood is that of contrasts of y that X does not reach. Of each channel those are its squared length
beyond X and Z, s^2 chi^2(f), and coordinates t along Z,

    t ~ N(0, S),   S = diag(s_c^2) + sum_k v_k T_k T_k'   (3 v^2 for columns of second order in a normal error),
    -2 log L = sum_c [f_c log s_c^2 + q_c / s_c^2] + log det S + t' S^-1 t + sum_j w_j (log x_j + a_j / x_j).

The last sum is the prior: each variance x_j is scaled inverse chi-square about a_j, which counts like w_j readings of
it. The minimum is found by Fisher scoring in log x; the information matrix gives the degrees of freedom of each
variance, 2 x^2 / var(x) (Satterthwaite).

References
----------
S. R. Searle, G. Casella and C. E. McCulloch, Variance Components (Wiley, 1992), section 6.6: restricted likelihood.
N. R. Draper and H. Smith, Applied Regression Analysis (Wiley, 1998), section 2.1: pure error.
S. R. Searle, G. Casella and C. E. McCulloch, Variance Components (Wiley, 1992), chapters 6 and 8.
F. E. Satterthwaite, Biometrics Bulletin 2 (1946) 110: degrees of freedom of an estimated variance.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse
from scipy.linalg import solve_triangular
from scipy.sparse.linalg import splu

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.identify.constants import (
    CORRELATION_SHOWN,
    CORRELATIONS,
    FLAT,
    LARGEST_CORRELATION,
    LARGEST_STEP,
    NO_VARIANCE,
    SEARCH_STEPS,
    SETTLED_STEP,
    SPANNED_SQUARE,
)


@dataclass(frozen=True, eq=False)
class Contrasts:
    """What the readings of one channel say once fixed effects are taken out of them."""

    square: float  # Squared length beyond the fixed and the random effects
    free: float  # Its degrees of freedom
    along: FloatArray  # Coordinates along the random effects, shape (k,)
    columns: FloatArray  # Of the random effects in them, shape (k, q)
    cost: float = 0.0  # -2 log restricted likelihood, the variance at its best and random effects taken for fixed


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
    likelihood = _likelihood(channels, group, second, scale, weight)
    low = np.log(scale) + np.log(NO_VARIANCE)
    x = np.log(scale if start is None else start)
    (cost, slope, curvature), moved = likelihood(x), np.inf
    for _ in range(SEARCH_STEPS):
        free = (x > low + 1e-9) | (slope < 0.0)
        step = np.zeros(len(x))
        damped = curvature[np.ix_(free, free)] + FLAT * np.eye(int(free.sum()))
        size = np.sqrt(np.diag(damped))
        inner = damped / np.outer(size, size) + 1e-9 * np.eye(len(size))
        step[free] = np.clip(-np.linalg.solve(inner, slope[free] / size) / size, -LARGEST_STEP, LARGEST_STEP)
        for _ in range(SEARCH_STEPS):
            there = np.maximum(x + step, low)
            after = likelihood(there)
            if after[0] <= cost + 1e-10 * abs(cost):
                break
            step /= 2.0
        else:
            break
        moved = float(np.abs(there - x).max())
        x, (cost, slope, curvature) = there, after
        if moved < SETTLED_STEP:
            break
    # The curvature is that of -2 log L in log x, so that the variance of log x is twice its inverse. A variance at the
    # lower end of the search is none, and its spread is that there
    variance = np.where(x > low + 1e-9, np.exp(x), 0.0)
    size = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    inverse = np.linalg.pinv(curvature / np.outer(size, size), rcond=1e-12, hermitian=True) / np.outer(size, size)
    squared = 2.0 * np.exp(2.0 * x)
    return Components(variance, squared * np.diag(inverse), squared / size**2, moved < SETTLED_STEP)


def _likelihood(
    channels: Sequence[Contrasts], group: IntArray, second: BoolArray, scale: FloatArray, weight: FloatArray
) -> Callable[[FloatArray], tuple[float, FloatArray, FloatArray]]:
    """Of log variances -2 log L of contrasts, its slope and its expected curvature."""
    t, columns = (np.concatenate(values) for values in zip(*((c.along, c.columns) for c in channels), strict=True))
    square, free = (np.array(values) for values in zip(*((c.square, c.free) for c in channels), strict=True))
    of = np.repeat(np.arange(len(channels)), [len(channel.along) for channel in channels])
    count = len(scale) - len(channels)
    in_group = (group[:, None] == np.arange(count)).astype(np.float64)
    in_channel = (of[:, None] == np.arange(len(channels))).astype(np.float64)

    def at(x: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        variance = np.exp(x)
        v, s = variance[:count][group], variance[count:]
        size, change = np.where(second, 3.0 * v**2, v), np.where(second, 6.0 * v, 1.0)
        total = (columns * size) @ columns.T
        total[np.diag_indices(len(total))] += s[of]
        lower = np.linalg.cholesky(total)
        root = solve_triangular(lower, np.eye(len(lower)), lower=True)
        inverse = root.T @ root
        a, solved = inverse @ t, inverse @ columns
        cost = float(
            free @ np.log(s)
            + np.sum(square / s)
            + 2.0 * np.log(np.diag(lower)).sum()
            + t @ a
            + np.sum(weight * (x - np.log(scale) + scale / variance - 1.0))
        )
        of_effects = change * (np.sum(columns * solved, axis=0) - (columns.T @ a) ** 2)
        of_channels = in_channel.T @ (np.diag(inverse) - a**2) + free / s - square / s**2
        slope = np.concatenate([in_group.T @ of_effects, of_channels]) * variance
        slope += weight * (1.0 - scale / variance)
        effects = np.outer(change, change) * (columns.T @ solved) ** 2
        both = in_channel.T @ (solved**2 * change) @ in_group
        alone = in_channel.T @ inverse**2 @ in_channel + np.diag(free / s**2)
        curvature = np.block([[in_group.T @ effects @ in_group, both.T], [both, alone]])
        return cost, slope, curvature * np.outer(variance, variance) + np.diag(weight)

    return at


@dataclass(frozen=True, eq=False)
class Chain:
    """Each reading's predecessor in its run, among the readings that are used."""

    before: IntArray  # Its own number where there is none; shape (n,)
    first: BoolArray  # Whether there is none; shape (n,)
    gap: FloatArray  # Readings since then, at least 1; shape (n,)

    def whitening(self, rho: FloatArray | float) -> sparse.csr_array:
        """The matrix W that makes readings independent which follow each other by a correlation, shape (n, n)."""
        share, rows = np.where(self.first, 0.0, rho**self.gap), np.arange(len(self.gap))
        root = np.sqrt(1.0 - share**2)
        place = np.concatenate([rows, rows]), np.concatenate([rows, self.before])
        return sparse.csr_array((np.concatenate([1.0 / root, -share / root]), place), shape=(len(rows), len(rows)))


@dataclass(frozen=True, eq=False)
class ChannelDesign:
    """The readings of a channel, less what the model predicts, and what else differs between them."""

    here: IntArray  # Numbers of the readings that are used, shape (n,)
    cell: IntArray  # The setting of each, of which it is a repeat, from 0; shape (n,)
    cells: int  # How many; 0 where smooth patterns stand in their place
    fixed: FloatArray  # Orthonormal columns that are taken out beside the cells, shape (n, f)
    random: FloatArray  # Columns of mounts and runs, shape (n, q)
    chain: Chain
    weight: FloatArray  # 1 over the standard deviation of each reading, over that of the channel; shape (n,)
    residual: FloatArray  # Shape (n,)
    at_rho: dict[int, Contrasts] = field(default_factory=dict)

    @property
    def free(self) -> int:
        """Degrees of freedom of what is left of the readings beside the cells, the fixed and the random effects."""
        return int(self.contrasts(0).free)

    def best_rho(self) -> int:
        """Number of the rho of largest restricted likelihood, mounts and runs taken for fixed.

        It is 0 unless the readings show another. Two passes without an order tell rho no more
        than by how their few differences vary: the likelihood is flat, while the variance grows like 1 / (1 - rho).
        """

        def cost(k: int) -> float:
            return self.contrasts(k).cost + (CORRELATION_SHOWN if k else 0.0)

        step = CORRELATIONS // 5
        best = min(range(0, CORRELATIONS + 1, step), key=cost)
        while step > 1:
            step //= 2
            best = min((k for k in (best, best - step, best + step) if 0 <= k <= CORRELATIONS), key=cost)
        return best

    def contrasts(self, k: int) -> Contrasts:
        """What the readings say of the variances at the k-th value of rho."""
        if k not in self.at_rho:
            # What is spanned by others is spanned by them at every rho
            self.at_rho[k] = _contrasts(self, rho_of(k), len(self.contrasts(0).along) if k else None)
        return self.at_rho[k]


def rho_of(k: int) -> float:
    """The k-th value of the correlation of successive readings."""
    return float(np.tanh(np.arctanh(LARGEST_CORRELATION) * k / CORRELATIONS))


def _contrasts(design: ChannelDesign, rho: float, rank: int | None) -> Contrasts:
    """Least squares of readings with correlated noise: cells by a sparse factor, the others by their products."""
    serial, size = design.chain.whitening(rho), np.linalg.norm(design.random, axis=0)
    whitening, moves = serial @ sparse.diags_array(design.weight), size > 0.0
    columns = [design.fixed, design.random[:, moves] / size[moves], design.residual[:, None]]
    white = whitening @ np.concatenate(columns, axis=1)
    products, determinant = white.T @ white, -2.0 * float(np.log(serial.diagonal()).sum())
    if design.cells:
        n = len(design.cell)
        indicator = whitening @ sparse.csr_array((np.ones(n), (np.arange(n), design.cell)), shape=(n, design.cells))
        factor, beside = splu((indicator.T @ indicator).tocsc()), indicator.T @ white
        products -= beside.T @ factor.solve(beside)
        determinant += float(np.log(np.abs(factor.U.diagonal())).sum())
    f = design.fixed.shape[1]
    triangle = np.linalg.cholesky(products[:f, :f])
    shared = np.linalg.solve(triangle, products[:f, f:])
    beyond = products[f:, f:] - shared.T @ shared
    values, vectors = np.linalg.eigh(beyond[:-1, :-1])
    rank = int(np.count_nonzero(values > SPANNED_SQUARE)) if rank is None else rank
    values, vectors = values[len(values) - rank :], vectors[:, len(values) - rank :]
    along = vectors.T @ beyond[:-1, -1] / np.sqrt(values)
    square, free = max(float(beyond[-1, -1] - along @ along), 0.0), len(design.here) - design.cells - f - rank
    random = np.zeros((rank, len(size)))
    random[:, moves] = np.sqrt(values)[:, None] * vectors.T * size[moves]
    determinant += 2.0 * float(np.log(np.diag(triangle)).sum()) + float(np.log(values).sum())
    return Contrasts(square, free, along, random, determinant + free * float(np.log(max(square, 1e-300))))
