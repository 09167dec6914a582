"""The noise model of a campaign, and the linear map that makes its readings independent with unit variance.

A reading is the truth plus AR(1) noise along its run (per channel), plus the channel's slope in distance times the
random position errors of its mount and of its stop of the stage, plus a random offset per run and channel.

References
----------
S. R. Searle, G. Casella and C. E. McCulloch, Variance Components (Wiley, 1992), chapter 6.
G. E. P. Box, G. M. Jenkins and G. C. Reinsel, Time Series Analysis (Wiley, 2008), section 3.2: AR(1).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.identify.observations import Observations, WithoutCache, once_for_settings
from femfit.identify.patterns import own_misfit_columns
from femfit.identify.settings import levels, setting_cells

MOST_STOPS = 200
"""Numerical, for the time that it takes: what more stops, mounts or runs differ by is left to readings' scatter."""


@dataclass(frozen=True, eq=False)
class Chain:
    """Each reading's predecessor in its run, among the readings that are used."""

    before: IntArray  # Any where there is none; shape (n,)
    gap: FloatArray  # Readings since then, at least 1; infinite where there is none; shape (n,)

    def of(self, here: IntArray) -> "Chain":
        """The chain of some readings (m,), ascending, among which each has its predecessor."""
        return Chain(np.searchsorted(here, self.before[here]), self.gap[here])

    def whitening(self, rho: FloatArray | float) -> sparse.csr_array:
        """The matrix W that makes readings independent which follow each other by a correlation, shape (n, n)."""
        share, rows = rho**self.gap, np.arange(len(self.gap))
        root = np.sqrt(1.0 - share**2)
        place = np.concatenate([rows, rows]), np.concatenate([rows, self.before])
        return sparse.csr_array((np.concatenate([1.0 / root, -share / root]), place), shape=(len(rows), len(rows)))


@once_for_settings
def sequence(observations: Observations) -> FloatArray:
    """Place of each reading in its run, shape (M,): as measured, or as benches scan where no clock tells it.

    That is distance by distance, up one branch and down the other, whatever the order of the rows. Readings that were
    taken otherwise do not resemble each other along it, and then have no correlation.
    """
    if observations.clocked:
        return observations.column("order")
    table = observations.covariates
    falling = (table["branch"] < 0.0).to_numpy()
    currents = [np.where(falling, -1.0, 1.0) * table[name].to_numpy() for name in observations.settings[1:]]
    scan = np.lexsort((*currents, falling, levels(table["distance_m"].to_numpy()), table["run"]))
    place = np.zeros(len(table))
    place[scan] = np.arange(len(table), dtype=np.float64)
    return place[observations.row]


@once_for_settings
def stops(observations: Observations) -> IntArray:
    """Number of the stop of the stage at which each reading was taken, from 0, shape (M,).

    Readings of a run that follow each other at the same recorded distance share by how much the stage was off.
    """
    run, distance = observations.column("run"), observations.column("distance_m")
    order = np.lexsort((observations.row, sequence(observations), run))
    begins = (np.diff(run[order]) != 0.0) | (np.diff(distance[order]) != 0.0)
    number = np.zeros(len(run), dtype=np.intp)
    number[order] = np.cumsum(np.append(False, begins))
    return number


def setting_errors(observations: Observations, stop_m: float) -> list[tuple[IntArray, FloatArray]]:
    """What errors of the settings make: who shares each, a number per reading, and its standard deviation, (M,).

    Readings of a stop share the error of the distance, those of a row that of the current. The square of a normal error
    of variance s^2 has the root mean square sqrt(3) s^2.
    """
    _, *currents = observations.setting_columns.T
    stop = stops(observations)
    bent = 0.5 * np.sqrt(3.0) * stop_m**2 * observations.distance_curvature
    errors = [(stop, stop_m * observations.distance_slope), (stop, bent)]
    errors += [(observations.row, column) for column in currents]
    return [(number, size) for number, size in errors if size.any()]


@once_for_settings
def chain_of(observations: Observations) -> Chain:
    """Link the readings that follow each other in a channel and run.

    Readings that are missing between two count where a clock tells them. Windows of a record share no samples: none
    follows another one, and what lasts from one to the next is a misfit.
    """
    channel, run, order = observations.channel, observations.column("run"), sequence(observations)
    before, gap = np.arange(len(run)), np.full(len(run), np.inf)
    sorting = np.lexsort((order, run, channel))
    same = (np.diff(channel[sorting]) == 0) & (np.diff(run[sorting]) == 0) & (not observations.in_motion)
    steps, later = np.diff(order[sorting])[same], sorting[1:][same]
    before[later] = sorting[:-1][same]
    gap[later] = np.maximum(steps, 1.0) if observations.clocked and len(later) and np.median(steps) == 1.0 else 1.0
    return Chain(before, gap)


@dataclass(frozen=True, eq=False)
class RandomEffects:
    """Columns of mounts, runs and stops: a variance for the mounts, one for each channel's runs, one for the stops.

    Stops have columns where the readings may tell them from the scatter of single rows.
    """

    columns: FloatArray  # Shape (M, q)
    # Which variance each has: 0 of mounts, 1 + c of the runs of channel c, 1 + channels of the stops; shape (q,)
    group: IntArray
    second: BoolArray  # Whether its effect is the square of a mount's error; shape (q,)
    # Mounts, and runs of each channel, less one, and stops less places of the stage; none of mounts of a single run,
    # unless the file says that the body was put back; shape (2 + channels,)
    differences: FloatArray

    def deviations(self, sizes: FloatArray) -> FloatArray:
        """The standard deviation of each where mounts, runs of each channel and stops have these, (2 + channels,)."""
        size = sizes[self.group]
        # The square of a normal error of variance s^2 has the root mean square sqrt(3) s^2
        return np.where(self.second, np.sqrt(3.0) * size**2, size)


@once_for_settings
def random_effects(observations: Observations) -> RandomEffects:
    """What the mounts, runs and stops of a campaign change of its readings."""
    mount, run, stop = observations.column("mount"), observations.column("run"), stops(observations)
    slope, curvature = observations.distance_slope[:, None], observations.distance_curvature[:, None]
    mounts, numbers = np.unique(mount), np.unique(stop)
    in_channel = observations.channel[:, None] == np.arange(len(observations.channels))
    runs = [np.unique(run[column]) for column in in_channel.T]
    put_back = ("mount" in observations.given or max(map(len, runs)) > 1) and len(mounts) <= MOST_STOPS
    # A stop that no other one repeats has the variance that is declared, if any is
    again = len(numbers) - len(np.unique(observations.column("distance_m")))
    repeated = max(again, int("distance_m" in observations.declared_noise))
    told_apart = repeated > 0 and 2 * len(numbers) <= min(len(observations.covariates), 2 * MOST_STOPS)
    runs = [of_channel if len(of_channel) <= MOST_STOPS else of_channel[:0] for of_channel in runs]
    each = mount[:, None] == (mounts if put_back else mounts[:0])
    blocks = [each * slope, 0.5 * each * curvature]
    blocks += [(run[:, None] == of_channel) & in_channel[:, [c]] for c, of_channel in enumerate(runs)]
    blocks += [(stop[:, None] == numbers) * slope] if told_apart else []
    widths, variances = [block.shape[1] for block in blocks], np.maximum(np.arange(len(blocks)) - 1, 0)
    between_runs = [max(len(of_channel) - 1.0, 0.0) for of_channel in runs]
    differences = [len(mounts) - 1.0 if put_back else 0.0, *between_runs, repeated * told_apart]
    return RandomEffects(
        columns=np.concatenate(blocks, axis=1).astype(np.float64),
        group=np.repeat(variances, widths),
        second=np.repeat(np.arange(len(blocks)) == 1, widths),
        differences=np.array(differences, dtype=np.float64),
    )


def random_columns(observations: Observations, mount_m: float, run: FloatArray) -> FloatArray:
    """Columns of mounts and runs, each by one standard deviation, shape (M, q); offsets of runs have ``run``."""
    effects = random_effects(observations)
    deviations = effects.deviations(np.array([mount_m, *run, 0.0]))
    return effects.columns[:, deviations > 0.0] * deviations[deviations > 0.0]


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Variances of a campaign."""

    channels: tuple[str, ...]
    sigma: FloatArray  # Standard deviation of a reading, in the channel's unit; shape (channels,)
    rho: FloatArray  # Correlation of successive readings; shape (channels,)
    mount_m: float
    run: FloatArray  # Standard deviation of a run's offset, in the channel's unit; shape (channels,)
    repeats: FloatArray  # Readings beside the first of each setting, where they count; (channels,)
    degrees_of_freedom: FloatArray  # Of ``sigma``, in independent readings; infinite where declared; (channels,)
    source: Mapping[str, str]
    stop_m: float = 0.0  # Of the distance at each stop of the stage; as declared where stops have no columns
    # Whether ``mount_m`` rests on the prior more than on the readings, since there are few mounts
    mount_assumed: bool = False
    never_varying: tuple[str, ...] = ()  # Channels that read the same wherever a setting was repeated

    @property
    def known(self) -> dict[str, float]:
        """Standard deviation of one reading per channel whose noise has a source."""
        return {name: float(s) for name, s in zip(self.channels, self.sigma, strict=True) if name in self.source}

    def pooled_degrees(self, channel: IntArray) -> float:
        """Degrees of freedom of the noise of whitened numbers together, by the channel of each.

        References
        ----------
        F. E. Satterthwaite, Biometrics Bulletin 2 (1946) 110: sums of estimated variances.
        """
        count = np.bincount(channel, minlength=len(self.channels)) * [name in self.source for name in self.channels]
        uncertain = float(np.sum(count**2 / self.degrees_of_freedom))
        return float(np.sum(count)) ** 2 / uncertain if uncertain else np.inf


@dataclass(frozen=True, eq=False)
class Whitening(WithoutCache):
    """The map to independent readings of unit variance."""

    observations: Observations
    noise: NoiseModel
    # What else scatters, each column by one standard deviation: the model's own misfit to its table; shape (M, n)
    misfit: FloatArray | None = None

    @classmethod
    def granting(cls, observations: Observations, noise: NoiseModel) -> Self:
        """The map that counts the model's own misfit to its table as noise."""
        return cls(observations, noise, own_misfit_columns(observations))

    @property
    def residual(self) -> FloatArray:
        """Recorded minus predicted with the noise whitened, shape (M,)."""
        return self.full(self.observations.residual)

    def with_values(self, value: FloatArray) -> Self:
        """The same map of other readings, of shape (M,), at the same settings."""
        result = replace(self, observations=self.observations.with_values(value))
        result.__dict__.update(self.__dict__ | vars(result))
        return result

    @cached_property
    def along_runs(self) -> sparse.csr_array:
        """The map of readings that follow each other in a run, shape (M, M)."""
        return chain_of(self.observations).whitening(self.noise.rho[self.observations.channel])

    @cached_property
    def _of_settings(self) -> Callable[[FloatArray], FloatArray]:
        """What errors of the settings make, once readings are independent along the runs."""
        observations = self.observations
        errors = setting_errors(observations, self.noise.stop_m)
        if self.misfit is not None and observations.of_impedances and observations.tolerance.any():
            # The states of eddy currents are chosen for the smallest largest error, which ripples over the frequency
            # and from one bias to the next: no smooth pattern has it, and repeats of a setting share it
            each = setting_cells(observations) * len(observations.channels) + observations.channel
            errors.append((np.unique(each, return_inverse=True)[1], observations.tolerance))
        rows, sigma = np.arange(len(observations.value)), self.noise.sigma[observations.channel]
        columns = [sparse.csr_array((size / sigma, (rows, number))) for number, size in errors]
        if not columns:
            return np.asarray
        return without_shared(self.along_runs @ sparse.hstack(columns, format="csr"))

    def serial(self, x: FloatArray) -> FloatArray:
        """Only the noise of each setting and along the runs whitened, for x of shape (M,) or (M, k)."""
        scaled = (x.T / self.noise.sigma[self.observations.channel]).T
        return self._of_settings(np.asarray(self.along_runs @ scaled))

    @cached_property
    def _random(self) -> FloatArray:
        """Array V, shape (M, n), of random effects beside errors of settings: whitened readings x become x - V V' x."""
        columns = random_columns(self.observations, self.noise.mount_m, self.noise.run)
        if self.misfit is not None:
            columns = np.concatenate([columns, self.misfit], axis=1)
        if not columns.shape[1]:
            return columns
        columns = self.serial(columns)
        squares, vectors = np.linalg.eigh(columns.T @ columns)
        # Of less than a thousandth of the noise's own variance there is none to speak of
        squares, vectors = squares[squares > 1e-3], vectors[:, squares > 1e-3]
        return np.asarray(columns @ (vectors * np.sqrt((1.0 - 1.0 / np.sqrt(1.0 + squares)) / squares)))

    def full(self, x: FloatArray) -> FloatArray:
        """All of the noise whitened, for x of shape (M,) or (M, k)."""
        serial = self.serial(x)
        return serial - self._random @ (self._random.T @ serial)


def without_shared(shared: sparse.csr_array) -> Callable[[FloatArray], FloatArray]:
    """The map to independent readings of those that share errors and are otherwise independent, of unit variance.

    The covariance is I + H H', with a sparse column of H, shape (M, n), for each error by one standard deviation. With
    the Cholesky factor L L' = I + H' H, the map T = I - H (I + L')^-1 L^-1 H' has T' T = (I + H H')^-1.

    References
    ----------
    A. Andrews, AIAA Journal 6 (1968) 1165: the square root of a covariance that a vector of readings updates.
    """
    n = shared.shape[1]
    normal = (shared.T @ shared + sparse.eye_array(n)).tocsc()
    # No pivoting: the matrix is positive definite, so that its factors are L and the transpose of L by the pivots
    symmetric: dict[str, Any] = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    factors = splu(normal, permc_spec="MMD_AT_PLUS_A", **symmetric)
    lower = factors.L @ sparse.diags_array(np.sqrt(factors.U.diagonal()))
    triangular = lower, sparse.eye_array(n) + lower.T
    inverse, beyond = (splu(each.tocsc(), permc_spec="NATURAL", **symmetric) for each in triangular)
    columns = shared[:, np.argsort(factors.perm_c)]  # in the order of least fill
    return lambda x: x - np.asarray(columns @ beyond.solve(inverse.solve(columns.T @ x)))
