"""Which readings of a campaign hold its noise alone, and what else differs between them."""

from dataclasses import dataclass

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.identify.comparison.patterns import drift_patterns, smooth_patterns
from femfit.identify.constants import LEAST_REPEATS
from femfit.identify.noise.contrasts import Chain, ChannelDesign
from femfit.identify.noise.whitening import chains_of, orthonormal_basis, sequence, stops
from femfit.identify.readings.observations import Observations, once_for_settings
from femfit.identify.readings.settings import repeat_cells


@dataclass(frozen=True, eq=False)
class RandomEffects:
    """Columns of mounts, runs and stops: a variance for the mounts, one for each channel's runs, one for the stops."""

    columns: FloatArray  # Shape (M, q)
    # Which variance each has: 0 of mounts, 1 + c of the runs of channel c, 1 + channels of the stops; shape (q,)
    group: IntArray
    second: BoolArray  # Whether its effect is the square of a mount's error; shape (q,)
    # Mounts, and runs of each channel, less one, and stops less places of the stage; shape (2 + channels,)
    differences: FloatArray

    @property
    def of_stops(self) -> BoolArray:
        """Which of the columns are of stops, the last of the variances; shape (q,)."""
        return np.asarray(self.group == len(self.differences) - 1)


@once_for_settings
def repeated_readings(observations: Observations) -> list[tuple[IntArray, IntArray, IntArray]]:
    """Of each channel the readings of settings that were repeated, cell by cell, where each cell starts, and all cells.

    The last are the numbers, from 0, of each reading's cell.
    """
    cells, result = repeat_cells(observations), []
    for c in range(len(observations.channels)):
        here = np.flatnonzero(observations.channel == c)
        _, code, count = np.unique(cells[here], return_inverse=True, return_counts=True)
        kept = here[count[code] > 1]
        sorting = kept[np.argsort(cells[kept], kind="stable")]
        _, start, cell = np.unique(cells[sorting], return_index=True, return_inverse=True)
        result.append((sorting, start, cell))
    return result


@once_for_settings
def random_effects(observations: Observations) -> RandomEffects:
    """Mounts, runs and stops of which there are several.

    A body of a single run was put back only where the file says so. Stops of single rows are not told from the scatter
    of readings.
    """
    mount, run = observations.column("mount"), observations.column("run")
    mounts, here = np.unique(mount), observations.channel[:, None] == np.arange(len(observations.channels))
    runs = [np.unique(run[column]) for column in here.T]
    put_back = len(mounts) > 1 and ("mount" in observations.given or max(map(len, runs)) > 1)
    columns, group, second = [], [], []
    if put_back:
        each = (mount[:, None] == mounts).astype(np.float64)
        columns += [each * observations.distance_slope[:, None], 0.5 * each * observations.distance_curvature[:, None]]
        group += 2 * len(mounts) * [0]
        second += len(mounts) * [False] + len(mounts) * [True]
    for c, there in enumerate(runs):
        if len(there) > 1:
            columns.append(((run[:, None] == there) & here[:, [c]]).astype(np.float64))
            group += len(there) * [1 + c]
            second += len(there) * [False]
    stop = stops(observations)
    numbers, rows = np.unique(stop), len(observations.covariates)
    repeated = len(numbers) - len(np.unique(observations.column("distance_m")))
    if repeated > 0 and 2 * len(numbers) <= rows:
        columns.append((stop[:, None] == numbers) * observations.distance_slope[:, None])
        group += len(numbers) * [1 + len(runs)]
        second += len(numbers) * [False]
    differences = [
        len(mounts) - 1.0 if put_back else 0.0,
        *(len(there) - 1.0 for there in runs),
        float(repeated) if 1 + len(runs) in group else 0.0,
    ]
    none = np.zeros((len(run), 0))
    return RandomEffects(
        np.concatenate([none, *columns], axis=1), np.array(group, int), np.array(second, bool), np.array(differences)
    )


@once_for_settings
def _designs(observations: Observations) -> list[dict[tuple[bool, bool], ChannelDesign]]:
    """Of each channel the designs for readings of equal variance, by whether from repeats, and with known stops."""
    return [{} for _ in observations.channels]


def channel_design(observations: Observations, c: int, repeats: bool, sigma: float = 0.0) -> ChannelDesign:
    """The design of a channel; sigma weighs what uncertain settings make against it where it is not 0.

    Stops have columns where enough of the repeats is left beside them.
    """
    design = _design(observations, c, repeats, sigma, stops_known=not repeats)
    enough = not repeats or design.free >= LEAST_REPEATS
    return design if enough else _design(observations, c, repeats, sigma, stops_known=True)


def _design(observations: Observations, c: int, repeats: bool, sigma: float, stops_known: bool) -> ChannelDesign:
    """The same where errors of stops are known, and weighed as those of single rows are, or have columns."""
    here = repeated_readings(observations)[c][0] if repeats else np.flatnonzero(observations.channel == c)
    effects = random_effects(observations)
    made = np.sum(uncertain_settings(observations, stops_known)[here] ** 2, axis=1)
    equal = sigma == 0.0 or not made.any()
    if equal and (repeats, stops_known) in _designs(observations)[c]:
        return _designs(observations)[c][repeats, stops_known]
    weight = np.ones(len(here)) if equal else 1.0 / np.sqrt(1.0 + made / sigma**2)
    cell = repeated_readings(observations)[c][2] if repeats else np.zeros(len(here), dtype=np.intp)
    order = np.lexsort((sequence(observations)[here], observations.column("run")[here]))
    here, weight, cell = here[order], weight[order], cell[order]
    patterns = (drift_patterns if repeats else smooth_patterns)(observations)
    # A distance error of all mounts is in no difference between them; nor is a hidden effect that looks like it
    common = np.stack([observations.distance_slope[here], observations.distance_curvature[here]], axis=1)
    fixed = np.concatenate([patterns.columns[np.ix_(here, np.flatnonzero(patterns.channel == c))], common], axis=1)
    if repeats:
        fixed = _within(fixed, cell)
    random = effects.columns[here] * ~(effects.of_stops & stops_known)
    cells = int(cell.max()) + 1 if repeats else 0
    design = ChannelDesign(here, cell, cells, orthonormal_basis(fixed), random, _chain(observations, here), weight)
    if equal:
        _designs(observations)[c][repeats, stops_known] = design
    return design


def uncertain_settings(observations: Observations, stops_known: bool) -> FloatArray:
    """Errors of settings that are weighed as if each row had its own: without those of stops that have columns."""
    has_columns = random_effects(observations).differences[-1] > 0.0 and not stops_known
    return observations.setting_columns[:, int(has_columns) :]


def _within(columns: FloatArray, cell: IntArray) -> FloatArray:
    """Columns less their mean in each cell; zero where rounding alone is left."""
    count = np.bincount(cell)
    means = np.stack([np.bincount(cell, column) for column in columns.T], axis=1) / count[:, None]
    left = columns - means[cell]
    seen = np.linalg.norm(left, axis=0) > 1e-9 * np.linalg.norm(columns, axis=0)
    return np.asarray(left * seen)


def _chain(observations: Observations, here: IntArray) -> Chain:
    """The chain of some readings of one channel, which stand run by run in their sequence."""
    chains, run = chains_of(observations), observations.column("run")[here]
    follows = np.append(False, run[1:] == run[:-1])
    # Readings since the start of the run, those that are not used and those that are missing included
    own = np.flatnonzero(observations.channel == observations.channel[here[0]])
    own = own[np.lexsort((sequence(observations)[own], observations.column("run")[own]))]
    place = np.zeros(len(observations.value))
    place[own] = np.cumsum(chains.gap[own])
    gap = np.where(follows, np.diff(place[here], prepend=0.0), 1.0)
    before = np.where(follows, np.arange(len(here)) - 1, np.arange(len(here)))
    return Chain(before, ~follows, gap)
