"""The readings of one channel as a design: what settings, and a hidden effect, may do is taken out of its residual.

Smooth patterns of the settings, temperatures and times are taken out, and what an error of the distance that all mounts
share would do. What the repeats of a setting share beyond them is a misfit that is not smooth; it has a variance of its
own, whose root over that of a reading is the setting's ``share``. Repeats tell the two apart.

Successive readings of a run are whitened by W, (y_i - r y_(i-1)) / sqrt(1 - r^2) with r = rho^gap, so that all of it is
least squares with the products X' W' W X.

References
----------
N. R. Draper and H. Smith, Applied Regression Analysis (Wiley, 1998), section 2.1: pure error.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
from scipy import sparse
from scipy.linalg import solve_triangular
from scipy.sparse.linalg import splu

from femfit.core.numerics import FloatArray, IntArray, root_beside_one
from femfit.estimate.record import converter_step
from femfit.identify.constants import LARGEST_CORRELATION, LEAST_REPEATS, OF_SETTINGS, PRIOR_MEMORY, PRIOR_SHARE
from femfit.identify.noise.likelihood import Contrasts
from femfit.identify.noise.whitening import Chain, chain_of, random_effects
from femfit.identify.observations import Observations
from femfit.identify.patterns import orthonormal_basis, smooth_patterns
from femfit.identify.settings import setting_cells

LEAST_SHARE, LARGEST_SHARE, SHARES = 0.1, 1000.0, 36
"""Numerical: shares of a setting that are tried, even in their logarithm, beside none."""

EXACT = 1e9
"""Numerical: the weight of a variance that is known."""

CORRELATIONS = 40
"""Numerical: correlations that are tried, even in artanh(rho), which moves the variance of a slow pattern,
(1 + rho) / (1 - rho), by 10 % from one to the next."""

SPANNED_SQUARE = 1e-9
"""Numerical: part of a squared length below which a column of mounts or runs is spanned by others."""


@dataclass(frozen=True, eq=False)
class ChannelDesign:
    """The readings of a channel, less what the model predicts, what else differs between them, and what is declared."""

    cell: IntArray  # The setting of each reading, from 0; shape (n,)
    fixed: FloatArray  # Orthonormal columns that are taken out, shape (n, f)
    random: FloatArray  # Columns of mounts, runs and stops, shape (n, q)
    chain: Chain
    made: FloatArray  # Variance by errors of the settings that are weighed as if each row had its own; shape (n,)
    residual: FloatArray  # Shape (n,)
    resolution: float = 0.0  # Standard deviation that rounding makes
    repeats: int = 0  # Readings beside the first of each setting, where they are enough to say a noise
    sigma: float = 0.0  # Against which errors of the settings are weighed; 0 where all readings have one weight
    declared: float = np.nan  # Standard deviation of a reading; NaN where nothing declares it
    counts_like: float = 0.0  # So many readings
    source: str = ""
    place: tuple[int, int] = (0, 0)  # Numbers of the correlation and of the setting's share
    cache: dict[tuple[int, int], Contrasts] = field(default_factory=dict)

    @property
    def _weight(self) -> FloatArray:
        """1 over the standard deviation of each reading, over that of the channel; shape (n,)."""
        return 1.0 / np.sqrt(1.0 + self.made / self.sigma**2) if self.sigma else np.ones(len(self.made))

    @property
    def variance(self) -> float:
        """Of a reading, random effects taken for fixed."""
        contrasts = self.contrasts(*self.place)
        declared_square = self.counts_like * self.declared**2 if self.counts_like else 0.0
        return (declared_square + contrasts.square) / (self.counts_like + max(contrasts.free, 1.0))

    @property
    def degrees_of_freedom(self) -> float:
        """Of the variance, counted in independent readings; infinite where it is known.

        Readings that follow each other by the correlation rho say it only as well as (1 - rho^2) / (1 + rho^2) times as
        many independent ones; and slow patterns have (1 + rho) / (1 - rho) of it, which rho's own uncertainty,
        (1 - rho^2) / n, makes uncertain by 4 / ((1 - rho^2) n) in relative variance, and by 8 rho of these more since a
        large correlation goes with a large variance.
        """
        rho, free = rho_of(self.place[0]), max(self.contrasts(*self.place).free, 1.0)
        if self.counts_like == EXACT:
            return np.inf
        independent = self.counts_like + free * (1.0 - rho**2) / (1.0 + rho**2)
        return 1.0 / ((2.0 + 4.0 * rho) * (rho > 0.0) / ((1.0 - rho**2) * free) + 1.0 / independent)

    def likeliest(self, ratio: FloatArray) -> Self:
        """With the likeliest correlation and share of the setting where random effects are (q,) times a reading's.

        Repeats, or a declaration, tell what a setting has from what a reading has; that is a misfit and no noise.
        """
        shared = bool(self.repeats or self.counts_like)
        most, best, step = (self._most_correlation, SHARES * shared), (0, 0), 8
        while step:
            near = [(best[0] + a * step, best[1] + b * step) for a, b in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))]
            tried = [(a, b) for a, b in near if 0 <= a <= most[0] and 0 <= b <= most[1]]
            better = min(tried, key=lambda place: self._whole_cost(place, ratio))
            best, step = (better, step) if better != best else (best, step // 2)
        return replace(self, place=best)

    def mean_correlation(self, ratio: FloatArray) -> float:
        """The correlation by which slow patterns scatter as they do over its posterior.

        They have (1 + rho) / (1 - rho) = exp(2 a) of the variance of independent readings, a = artanh(rho); few
        readings say little of it, and none that it is zero.
        """
        around = range(self.place[0] % 4, self._most_correlation + 1, 4)
        if len(around) < 2:
            return rho_of(self.place[0])
        costs = np.array([self._whole_cost((k, self.place[1]), ratio) for k in around])
        a = np.arctanh([rho_of(k) for k in around])
        density = np.exp(-0.5 * (costs - costs.min())) * np.cosh(a)  # the prior is one of sinh(a)
        return float(np.tanh(0.5 * np.log(np.trapezoid(density * np.exp(2.0 * a), a) / np.trapezoid(density, a))))

    @property
    def _most_correlation(self) -> int:
        """Number of the largest correlation; 0 where too few readings follow each other."""
        return CORRELATIONS if np.isfinite(self.chain.gap).sum() >= LEAST_REPEATS else 0

    def _whole_cost(self, place: tuple[int, int], ratio: FloatArray) -> float:
        """-2 log of likelihood and prior at numbers of the correlation and of the share, the variance the likeliest.

        Whatever was declared: were too large a noise believed, readings that differ by less would seem to follow each
        other.
        """
        contrasts = self.contrasts(*place)
        random = contrasts.columns * ratio
        lower = root_beside_one(random @ random.T)
        along = solve_triangular(lower, contrasts.along, lower=True)
        square, free = contrasts.square + float(along @ along), contrasts.free + len(along)
        log_det = 2.0 * float(np.log(np.diag(lower)).sum())
        return free * float(np.log(max(square, 1e-300))) + log_det + self.cost(place)

    def cost(self, place: tuple[int, int]) -> float:
        """What -2 log of likelihood and prior have of a correlation and a share, beside that of the variances."""
        rho, share = rho_of(place[0]), share_of(place[1])
        memory = rho / np.sqrt(1.0 - rho**2)
        prior = 2.0 * np.log1p((memory / PRIOR_MEMORY) ** 2) + 2.0 * np.log1p((share / PRIOR_SHARE) ** 2)
        return self.contrasts(*place).log_det + float(prior)

    def contrasts(self, memory: int, share: int) -> Contrasts:
        """What the readings say of the variances at these numbers of the correlation and of the setting's share."""
        if (memory, share) not in self.cache:
            self.cache[memory, share] = self._contrasts(rho_of(memory), share_of(share))
        return self.cache[memory, share]

    @cached_property
    def _columns(self) -> tuple[FloatArray, FloatArray, int]:
        """Everything as columns, the fixed ones first and the residual last; the size of the random ones.

        At last how many of these the fixed ones do not span: at no correlation, as at every one.
        """
        size = np.linalg.norm(self.random, axis=0)
        moving = self.random[:, size > 0.0] / size[size > 0.0]
        basis, random = orthonormal_basis(self.fixed * self._weight[:, None]), moving * self._weight[:, None]
        beyond = random - basis @ (basis.T @ random)
        rank = int(np.count_nonzero(np.linalg.eigvalsh(beyond.T @ beyond) > SPANNED_SQUARE))
        return np.concatenate([self.fixed, moving, self.residual[:, None]], axis=1), size, rank

    def _contrasts(self, rho: float, share: float) -> Contrasts:
        """Least squares of readings with correlated noise: settings by a sparse factor, others by their products."""
        serial, (columns, size, rank), n = self.chain.whitening(rho), self._columns, len(self.cell)
        whitening = serial @ sparse.diags_array(self._weight)
        white = whitening @ columns
        products, log_det = white.T @ white, -2.0 * float(np.log(serial.diagonal()).sum())
        if share:
            settings = int(self.cell.max()) + 1
            indicator = whitening @ sparse.csr_array(
                (np.full(n, share), (np.arange(n), self.cell)), shape=(n, settings)
            )
            factor = splu((indicator.T @ indicator + sparse.eye_array(settings)).tocsc())
            beside = indicator.T @ white
            products -= beside.T @ factor.solve(beside)
            log_det += float(np.log(np.abs(factor.U.diagonal())).sum())
        f = self.fixed.shape[1]
        triangle = np.linalg.cholesky(products[:f, :f])
        shared = np.linalg.solve(triangle, products[:f, f:])
        beyond = products[f:, f:] - shared.T @ shared
        values, vectors = np.linalg.eigh(beyond[:-1, :-1])
        values, vectors = values[len(values) - rank :], vectors[:, len(values) - rank :]
        along = vectors.T @ beyond[:-1, -1] / np.sqrt(values)
        square = max(float(beyond[-1, -1] - along @ along), 0.0)
        random = np.zeros((rank, len(size)))
        random[:, size > 0.0] = np.sqrt(values)[:, None] * vectors.T * size[size > 0.0]
        log_det += 2.0 * float(np.log(np.diag(triangle)).sum())
        return Contrasts(square, n - f - rank, along, random, log_det)


def rho_of(k: int) -> float:
    """The k-th value of the correlation of successive readings."""
    return float(np.tanh(np.arctanh(LARGEST_CORRELATION) * k / CORRELATIONS))


def share_of(k: int) -> float:
    """The k-th standard deviation of what repeats share, over that of a reading; 0 for the first."""
    return LEAST_SHARE * (LARGEST_SHARE / LEAST_SHARE) ** ((k - 1) / (SHARES - 1)) if k else 0.0


def channel_design(observations: Observations, c: int) -> ChannelDesign:
    """The design of a channel that has readings, of which nothing is declared."""
    of_channel, effects, patterns = (
        np.flatnonzero(observations.channel == c),
        random_effects(observations),
        smooth_patterns(observations),
    )
    cell = np.unique(setting_cells(observations)[of_channel], return_inverse=True)[1]
    settings = int(cell.max()) + 1
    numbers = np.flatnonzero(patterns.channel == c)[: max(1, int(OF_SETTINGS * settings))]
    # A distance error of all mounts is in no difference between them; nor is a hidden effect that looks like it, or an
    # error of the stage that every run meets at the same place
    common = np.stack([observations.distance_slope[of_channel], observations.distance_curvature[of_channel]], axis=1)
    distance, stops_repeat = observations.column("distance_m")[of_channel], effects.differences[-1] > 0.0
    places = (distance[:, None] == np.unique(distance)[: len(distance) * stops_repeat]) * common[:, :1]
    # Windows of a record that share a setting share no motion, and what their edges of a command are off by
    repeats = 0 if observations.in_motion else len(cell) - settings
    return ChannelDesign(
        cell,
        fixed=orthonormal_basis(
            np.concatenate([patterns.columns[np.ix_(of_channel, numbers)], common, places], axis=1)
        ),
        random=effects.columns[of_channel] * (effects.differences > 0.0)[effects.group],
        chain=chain_of(observations).of(of_channel),
        # Those of stops of the stage have columns, if any
        made=np.sum(observations.setting_columns[of_channel, int(stops_repeat) :] ** 2, axis=1),
        residual=observations.residual[of_channel],
        resolution=converter_step(np.unique(observations.value[of_channel])) / np.sqrt(12.0),
        repeats=repeats if repeats >= LEAST_REPEATS else 0,
    )
