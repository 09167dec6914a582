"""Contrasts of one channel that hold its noise alone: free of everything that settings, and a hidden effect, may do.

Where a channel has repeats, each setting has a mean of its own (``cells``), so that only the differences between
repeats are left. Where it has not, smooth patterns are taken out instead. Temperatures and times are taken out
besides, and what an error of the distance that all mounts share would do.

Successive readings of a run are whitened by W, (y_i - r y_(i-1)) / sqrt(1 - r^2) with r = rho^gap, so that all of it
is least squares with the products X' W' W X. Those depend on the settings and on rho alone: they are kept for each
rho of a grid, and new readings cost a few products of a vector.

References
----------
S. R. Searle, G. Casella and C. E. McCulloch, Variance Components (Wiley, 1992), section 6.6: restricted likelihood.
N. R. Draper and H. Smith, Applied Regression Analysis (Wiley, 1998), section 2.1: pure error.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.identify.constants import CORRELATION_SHOWN, CORRELATIONS, LARGEST_CORRELATION, SPANNED_SQUARE
from femfit.identify.noise.restricted import Contrasts


@dataclass(frozen=True, eq=False)
class Chain:
    """Each reading's predecessor in its run, among the readings that are used."""

    before: IntArray  # Its own number where there is none; shape (n,)
    first: BoolArray  # Whether there is none; shape (n,)
    gap: FloatArray  # Readings since then, at least 1; shape (n,)


@dataclass(frozen=True, eq=False)
class ChannelDesign:
    """What is known of a channel's readings before they are read."""

    here: IntArray  # Numbers of the readings that are used, shape (n,)
    cell: IntArray  # The setting of each, of which it is a repeat, from 0; shape (n,)
    cells: int  # How many; 0 where smooth patterns stand in their place
    fixed: FloatArray  # Orthonormal columns that are taken out beside the cells, shape (n, f)
    random: FloatArray  # Columns of mounts and runs, shape (n, q)
    chain: Chain
    weight: FloatArray  # 1 over the standard deviation of each reading, over that of the channel; shape (n,)
    kept: dict[int, "_AtRho"] = field(default_factory=dict)

    @cached_property
    def size(self) -> FloatArray:
        """Length of each random effect's column, shape (q,)."""
        return np.asarray(np.linalg.norm(self.random, axis=0))

    @cached_property
    def dense(self) -> FloatArray:
        """Fixed columns, and those of random effects that change a reading, of unit length."""
        seen = self.size > 0.0
        return np.concatenate([self.fixed, self.random[:, seen] / self.size[seen]], axis=1)

    def at(self, k: int) -> "_AtRho":
        """The least-squares problem at the k-th value of rho."""
        if k not in self.kept:
            self.kept[k] = _AtRho(self, rho_of(k), self.kept[0].rank if 0 in self.kept else None)
        return self.kept[k]

    @property
    def free(self) -> int:
        """Degrees of freedom of what is left of the readings beside the cells, the fixed and the random effects."""
        return len(self.here) - self.cells - int(self.fixed.shape[1]) - self.at(0).rank

    def best_rho(self, y: FloatArray) -> int:
        """Number of the rho of largest restricted likelihood, mounts and runs taken for fixed; y has the shape (n,).

        It is 0 unless the readings show another. Two passes without an order tell rho no more
        than by how their few differences vary: the likelihood is flat, while the variance grows like 1 / (1 - rho).
        """
        costs: dict[int, float] = {}

        def cost(k: int) -> float:
            if k not in costs:
                costs[k] = self.at(k).cost(y, self.free) + (CORRELATION_SHOWN if k else 0.0)
            return costs[k]

        step = CORRELATIONS // 5
        best = min(range(0, CORRELATIONS + 1, step), key=cost)
        while step > 1:
            step //= 2
            best = min((k for k in (best, best - step, best + step) if 0 <= k <= CORRELATIONS), key=cost)
        return best

    def contrasts(self, y: FloatArray, k: int) -> Contrasts:
        """What readings y, of shape (n,), say of the variances, at the k-th value of rho."""
        square, along = self.at(k).reduced(y)
        return Contrasts(square, float(self.free), along, self.at(k).columns)


def rho_of(k: int) -> float:
    """The k-th value of the correlation of successive readings."""
    return float(np.tanh(np.arctanh(LARGEST_CORRELATION) * k / CORRELATIONS))


class _AtRho:
    """Least squares of one channel's readings with correlated noise: cells by a sparse factor, the others dense."""

    def __init__(self, design: ChannelDesign, rho: float, rank: int | None) -> None:
        chain = design.chain
        self.design = design
        self.share = np.where(chain.first, 0.0, rho**chain.gap)
        self.root = np.sqrt(1.0 - self.share**2)
        size, seen = design.size, design.size > 0.0
        white = self._white(design.dense)
        products = white.T @ white
        self.cells: SuperLU | None = None
        determinant = 2.0 * float(np.log(self.root).sum())
        if design.cells:
            indicator = self._cells()
            self.cells = splu((indicator.T @ indicator).tocsc())
            determinant += float(np.log(np.abs(self.cells.U.diagonal())).sum())
            self.beside = indicator.T @ white
            products -= self.beside.T @ self.cells.solve(self.beside)
        f = design.fixed.shape[1]
        self.fixed = np.linalg.cholesky(products[:f, :f]) if f else np.zeros((0, 0))
        determinant += 2.0 * float(np.log(np.diag(self.fixed)).sum())
        self.shared = np.linalg.solve(self.fixed, products[:f, f:]) if f else np.zeros((0, products.shape[1]))
        values, vectors = np.linalg.eigh(products[f:, f:] - self.shared.T @ self.shared)
        # What is spanned by the others is spanned by them at every rho
        self.rank = int(np.count_nonzero(values > SPANNED_SQUARE)) if rank is None else rank
        values, vectors = values[len(values) - self.rank :], vectors[:, len(values) - self.rank :]
        self.directions = vectors / np.sqrt(values)
        self.columns = np.zeros((self.rank, len(size)))
        self.columns[:, seen] = np.sqrt(values)[:, None] * vectors.T * size[seen]
        self.determinant = determinant + float(np.log(values).sum())

    def _white(self, x: FloatArray) -> FloatArray:
        """Columns of shape (n, k), weighted and with the correlation of successive rows taken out."""
        scaled = x * self.design.weight[:, None]
        return np.asarray((scaled - self.share[:, None] * scaled[self.design.chain.before]) / self.root[:, None])

    def _cells(self) -> sparse.csr_array:
        """The same of one column a cell."""
        weight, cell, n = self.design.weight, self.design.cell, len(self.share)
        before, rows = self.design.chain.before, np.arange(n)
        values = np.concatenate([weight / self.root, -self.share * weight[before] / self.root])
        place = (np.concatenate([rows, rows]), np.concatenate([cell, cell[before]]))
        return sparse.csr_array((values, place), shape=(n, self.design.cells))

    def reduced(self, y: FloatArray) -> tuple[float, FloatArray]:
        """The squared length of readings beyond all effects, and their coordinates along the random ones."""
        design, before = self.design, self.design.chain.before
        scaled = y * design.weight
        white = (scaled - self.share * scaled[before]) / self.root
        # W' W y, so that its products with columns are those of the whitened ones
        back = white / self.root
        back = (back - np.bincount(before, self.share * back, len(back))) * design.weight
        square, along = float(white @ white), design.dense.T @ back
        if self.cells is not None:
            of_cells = np.bincount(design.cell, back, minlength=design.cells)
            means = self.cells.solve(of_cells)
            square -= float(of_cells @ means)
            along = along - self.beside.T @ means
        f = len(self.fixed)
        if f:
            part = np.linalg.solve(self.fixed, along[:f])
            square -= float(part @ part)
            along = along - np.concatenate([along[:f], self.shared.T @ part])
        seen = self.directions.T @ along[f:]
        return max(square - float(seen @ seen), 0.0), seen

    def cost(self, y: FloatArray, free: int) -> float:
        """-2 log of the restricted likelihood, the variance at its best."""
        return self.determinant + free * float(np.log(max(self.reduced(y)[0], 1e-300)))
