"""The noise model of a campaign, and the linear map that makes its readings independent with unit variance.

A reading is the truth plus AR(1) noise along its run (per channel), plus the channel's slope in distance times the
random position errors of its mount and of its stop of the stage, plus a random offset per run and channel.

References
----------
S. R. Searle, G. Casella and C. E. McCulloch, Variance Components (Wiley, 1992), chapter 6.
G. E. P. Box, G. M. Jenkins and G. C. Reinsel, Time Series Analysis (Wiley, 2008), section 3.2: AR(1).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from scipy import sparse

from femfit.core.numerics import FloatArray, IntArray
from femfit.identify.constants import SAME_SETTING
from femfit.identify.noise.contrasts import Chain
from femfit.identify.observations import Observations, WithoutCache, once_for_settings
from femfit.identify.patterns import own_misfit_columns
from femfit.identify.settings import levels, setting_cells


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
    scan = np.lexsort((*currents, falling, levels(table["distance_m"].to_numpy(), SAME_SETTING), table["run"]))
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

    Readings of a stop share the error of the distance, those of a row that of the current.
    """
    distance, *currents = observations.setting_columns.T
    if stop_m > 0.0:
        distance = stop_m * observations.distance_slope
    errors = [(stops(observations), distance), *((observations.row, column) for column in currents)]
    return [(number, size) for number, size in errors if size.any()]


def rough_misfit(observations: Observations) -> list[tuple[IntArray, FloatArray]]:
    """Of impedances the model's own misfit as no smooth pattern has it, as :func:`setting_errors`.

    The states of eddy currents are chosen for the smallest largest error, which ripples over the frequency and from one
    bias to the next. Repeats of a setting share it.
    """
    if not observations.of_impedances or not observations.tolerance.any():
        return []
    each = setting_cells(observations) * len(observations.channels) + observations.channel
    return [(np.unique(each, return_inverse=True)[1], observations.tolerance)]


def chains_of(observations: Observations) -> Chain:
    """Link the readings of each channel and run in their sequence."""
    run, order = observations.column("run"), sequence(observations)
    sorting = np.lexsort((order, run, observations.channel))
    same = (np.diff(observations.channel[sorting]) == 0) & (np.diff(run[sorting]) == 0)
    before, first, gap = np.arange(len(run)), np.ones(len(run), dtype=bool), np.ones(len(run))
    before[sorting[1:][same]] = sorting[:-1][same]
    first[sorting[1:][same]] = False
    steps = np.diff(order[sorting])[same]
    if observations.clocked and len(steps) and np.median(steps) == 1.0:
        gap[sorting[1:][same]] = np.maximum(steps, 1.0)
    return Chain(before, first, gap)


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Variances of a campaign."""

    channels: tuple[str, ...]
    sigma: FloatArray  # Standard deviation of a reading, in the channel's unit; shape (channels,)
    rho: FloatArray  # Correlation of successive readings; shape (channels,)
    mount_m: float
    run: FloatArray  # Standard deviation of a run's offset, in the channel's unit; shape (channels,)
    # Degrees of freedom of ``sigma``, counted in readings and in independent ones; infinite where declared; (channels,)
    repeats: FloatArray
    degrees_of_freedom: FloatArray
    source: Mapping[str, str]
    # The same standard deviations as tests use them: widened for having been estimated from few mounts and runs
    test_mount_m: float
    test_run: FloatArray
    stop_m: float = 0.0  # Of the distance at each stop of the stage, as repeats show it; 0 where they do not
    test_stop_m: float = 0.0
    # Whether ``mount_m`` rests on the prior more than on the readings, since there are few mounts
    mount_assumed: bool = False
    never_varying: tuple[str, ...] = ()  # Channels that read the same wherever a setting was repeated

    @property
    def floor(self) -> dict[str, float]:
        """Standard deviation of one reading per channel."""
        return dict(zip(self.channels, (float(s) for s in self.sigma), strict=True))

    @property
    def known(self) -> dict[str, float]:
        """The same of the channels whose noise has a source."""
        return {name: sigma for name, sigma in self.floor.items() if name in self.source}


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

    @cached_property
    def _share(self) -> FloatArray:
        """Share of the noise of the reading before in each reading's, shape (M,)."""
        rho = self.noise.rho[self.observations.channel] ** chains_of(self.observations).gap
        return np.where(chains_of(self.observations).first, 0.0, rho)

    @cached_property
    def _settings(self) -> list[tuple[sparse.csr_array, FloatArray]]:
        """The unit vectors of those that share the error of a setting, shape (n, M), and how far they shrink.

        The readings of a stop share its error g, so that their covariance is I + g g' with the inverse root
        I - (1 - (1 + g'g)^-1/2) g g' / g'g; the second error is first mapped by that of the first.
        """
        observations = self.observations
        maps: list[tuple[sparse.csr_array, FloatArray]] = []
        errors = setting_errors(observations, self.noise.test_stop_m)
        if self.misfit is not None:
            errors += rough_misfit(observations)
        for number, size in errors:
            error = _shrunk(size / self.noise.sigma[observations.channel], maps)
            length = np.sqrt(np.bincount(number, error**2))
            unit = error / np.maximum(length, 1e-300)[number]
            shape = len(length), len(error)
            shared = sparse.csr_array((unit, (number, np.arange(len(error)))), shape=shape)
            maps.append((shared, 1.0 - 1.0 / np.sqrt(1.0 + length**2)))
        return maps

    def serial(self, x: FloatArray) -> FloatArray:
        """Only the noise of each setting and along the runs whitened, for x of shape (M,) or (M, k)."""
        share, sigma = self._share, self.noise.sigma[self.observations.channel]
        if x.ndim == 2:
            share, sigma = share[:, None], sigma[:, None]
        scaled = _shrunk(x / sigma, self._settings)
        return (scaled - share * scaled[chains_of(self.observations).before]) / np.sqrt(1.0 - share**2)

    @cached_property
    def _random(self) -> tuple[FloatArray, FloatArray]:
        """Left singular vectors of the random effects' columns and the factor that shrinks along them."""
        columns, deviations = random_columns(self.observations, self.noise.test_mount_m, self.noise.test_run)
        columns = columns[:, deviations > 0.0] * deviations[deviations > 0.0]
        if self.misfit is not None:
            columns = np.concatenate([columns, self.misfit], axis=1)
        if not columns.shape[1]:
            return columns, np.zeros(0)
        columns = self.serial(columns)
        squares, vectors = np.linalg.eigh(columns.T @ columns)
        counts = squares > 1e-3  # Less than a thousandth of the noise's own variance: the rest is no noise to speak of
        directions = columns @ (vectors[:, counts] / np.sqrt(squares[counts]))
        return directions, 1.0 - 1.0 / np.sqrt(1.0 + squares[counts])

    def full(self, x: FloatArray) -> FloatArray:
        """All of the noise whitened, for x of shape (M,) or (M, k)."""
        directions, shrink = self._random
        serial = self.serial(x)
        along = directions.T @ serial
        return serial - directions @ ((shrink if x.ndim == 1 else shrink[:, None]) * along)


def _shrunk(x: FloatArray, maps: list[tuple[sparse.csr_array, FloatArray]]) -> FloatArray:
    """x, of shape (M,) or (M, k), shrunk along unit vectors."""
    for unit, shrink in maps:
        x = x - unit.T @ ((shrink if x.ndim == 1 else shrink[:, None]) * (unit @ x))
    return x


def random_columns(observations: Observations, mount_m: float, run: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Columns of the random effects, shape (M, q), and the standard deviation of each, shape (q,).

    One column a mount to first order, one to second, then one a channel and run, whose offsets scatter by ``run``.
    """
    mount, runs = observations.column("mount").astype(int), observations.column("run").astype(int)
    mounts = np.unique(mount)
    here = mount[:, None] == mounts
    columns = [here * observations.distance_slope[:, None], 0.5 * here * observations.distance_curvature[:, None]]
    # The square of a normal error of variance s^2 has the root mean square sqrt(3) s^2
    deviations = [np.full(len(mounts), mount_m), np.full(len(mounts), np.sqrt(3.0) * mount_m**2)]
    for c in range(len(observations.channels)):
        here = observations.channel == c
        there = np.unique(runs[here])
        columns.append((runs[:, None] == there) & here[:, None])
        deviations.append(np.full(len(there), run[c]))
    return np.concatenate(columns, axis=1).astype(np.float64), np.concatenate(deviations)


def orthonormal_basis(columns: FloatArray) -> FloatArray:
    """An orthonormal basis of the space of columns of any scale; zero and dependent columns are passed over.

    From the eigenvectors of the scaled columns' products, which is several times faster than QR for many rows;
    directions below 1e-5 of the longest are passed over, so the basis is orthonormal to about 1e-6.
    """
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0.0] / size[size > 0.0]
    if not columns.shape[1]:
        return columns
    values, vectors = np.linalg.eigh(columns.T @ columns)
    keep = values > 1e-10 * values[-1]
    return np.asarray(columns @ (vectors[:, keep] / np.sqrt(values[keep])))
