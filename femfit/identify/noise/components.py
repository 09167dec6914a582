"""Estimates the noise of a campaign: from repeats where there are any, else as declared, else as a guess.

The scatter of a reading comes from repeats of one setting, after each mount's position, each run's offset and what
temperature and time do were removed; its correlation along a run and the scatter of mounts and runs from what a smooth
surface leaves. Nothing here looks at an effect, and a hidden one does not widen the noise: it is the same in every
repeat.

References
----------
S. R. Searle, G. Casella and C. E. McCulloch, Variance Components (Wiley, 1992), chapters 6 and 8 (restricted maximum
likelihood, prior scale).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy import optimize, stats

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.identify.comparison.patterns import drift_patterns, smooth_patterns
from femfit.identify.constants import (
    CORRELATION_PRICE,
    LARGEST_CORRELATION,
    LEAST_REPEATS,
    LEAST_REPEATS_AGAINST_DECLARED,
    PRIOR_MOUNT_DOF,
    PRIOR_MOUNT_M,
    PRIOR_RUN,
    PRIOR_RUN_DOF,
    SAME_READING,
    TEST_LEVEL,
    UNKNOWN_CHANNEL,
)
from femfit.identify.noise.smoothness import guessed_noise
from femfit.identify.noise.whitening import Chains, NoiseModel, Whitening, chains_of, orthonormal_basis, random_columns
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.repeats import pure_error, repeat_cells


def estimate_noise(observations: Observations) -> NoiseModel | None:
    """The noise model of a campaign.

    None where neither repeats nor a declaration say the noise of any channel, and it cannot be guessed either.
    """
    cells = repeat_cells(observations)
    constant = never_varying(observations, cells)
    sigma, degrees, source = _scatter(observations, cells, constant)
    if not np.isfinite(sigma).any():
        sigma, degrees, source = _guesses(observations)
    if not np.isfinite(sigma).any():
        return None
    channels = len(observations.channels)
    chains = chains_of(observations)
    noise = NoiseModel(
        channels=observations.channels,
        sigma=np.where(np.isfinite(sigma), sigma, UNKNOWN_CHANNEL * np.nanmax(sigma)),
        rho=np.zeros(channels),
        mount_m=PRIOR_MOUNT_M,
        run=np.zeros(channels),
        degrees_of_freedom=degrees,
        repeats=degrees,
        source=source,
        test_mount_m=PRIOR_MOUNT_M,
        test_run=np.zeros(channels),
        never_varying=tuple(constant),
    )
    patterns = smooth_patterns(observations).columns
    noise = _with_serial(noise, observations, chains, patterns)
    return _with_random(noise, observations, chains, patterns)


def _scatter(
    observations: Observations, cells: IntArray, constant: Sequence[str]
) -> tuple[FloatArray, FloatArray, dict[str, str]]:
    """Sigma, its degrees of freedom and its source per channel; NaN where nothing says it."""
    count = len(observations.channels)
    sigma, degrees, source = np.full(count, np.nan), np.zeros(count), {}
    nuisance = np.concatenate(
        [random_columns(observations, 1.0, np.ones(count))[0], drift_patterns(observations).columns], axis=1
    )
    residual = observations.residual
    for c, name in enumerate(observations.channels):
        here = observations.channel == c
        square, dof = pure_error(residual[here], cells[here], nuisance[here])
        if name in observations.declared_noise:
            sigma[c], degrees[c], source[name] = observations.declared_noise[name], np.inf, observations.noise_source
        if name in constant:
            dof = 0.0  # a dead sensor, or one coarser than its noise: only rounding is left
        if dof > 0.0:
            square = _without_settings(observations, here, cells, square / dof, dof) * dof
        if dof >= (LEAST_REPEATS_AGAINST_DECLARED if name in source else LEAST_REPEATS) and square > 0.0:
            sigma[c], degrees[c], source[name] = np.sqrt(square / dof), dof, "repeats"
    return sigma, degrees, source


def _guesses(observations: Observations) -> tuple[FloatArray, FloatArray, dict[str, str]]:
    """The same from the smoothness of the misfit, where nothing says the noise of any channel."""
    count = len(observations.channels)
    sigma, degrees, source = np.full(count, np.nan), np.zeros(count), {}
    for c, name in enumerate(observations.channels):
        guess, free = guessed_noise(observations, name)
        if guess > SAME_READING * float(np.abs(observations.value[observations.channel == c]).max()):
            sigma[c], degrees[c], source[name] = guess, free, "guess"
    return sigma, degrees, source


def never_varying(observations: Observations, cells: IntArray | None = None) -> list[str]:
    """Channels whose readings are the same, but for the rounding of a float, wherever a setting was repeated."""
    cells = repeat_cells(observations) if cells is None else cells
    names = []
    for c, name in enumerate(observations.channels):
        here = observations.channel == c
        value = pd.Series(observations.value[here]).groupby(cells[here])
        spread = (value.max() - value.min()).to_numpy()
        repeated = int(np.sum(value.size() - 1))
        if repeated >= LEAST_REPEATS and spread.max() <= SAME_READING * float(np.abs(observations.value[here]).max()):
            names.append(name)
    return names


def _without_settings(
    observations: Observations, here: BoolArray, cells: IntArray, variance: float, degrees_of_freedom: float
) -> float:
    """The variance of repeats without what the declared errors of their settings make of it, which counts by itself.

    It is not less than the standard error of a variance from so many repeats: below that nothing can be told apart.
    """
    _, cell, count = np.unique(cells[here], return_inverse=True, return_counts=True)
    made = np.sum(observations.setting_columns[here] ** 2, axis=1)[count[cell] > 1]
    return max(variance - float(np.mean(made)), variance * float(np.sqrt(2.0 / degrees_of_freedom)))


def _with_serial(noise: NoiseModel, observations: Observations, chains: Chains, patterns: FloatArray) -> NoiseModel:
    """The noise with the correlation of successive readings: per channel the one of largest restricted likelihood.

    Readings that follow each other by the autocorrelation rho say the variance only as well as
    (1 - rho^2) / (1 + rho^2) times as many independent ones; and slow patterns have (1 + rho) / (1 - rho) of that
    variance, which rho's own uncertainty, (1 - rho^2) / n, makes uncertain by 4 / ((1 - rho^2) n) in relative variance.
    """
    random, _ = random_columns(observations, 1.0, np.ones(len(noise.channels)))
    design = np.concatenate([patterns, random], axis=1)
    rho = np.zeros(len(noise.channels))
    for c in range(len(rho)):
        here = np.flatnonzero(observations.channel == c)
        position = np.full(len(observations.value), -1)
        position[here] = np.arange(len(here))
        first, before, gap = chains.first[here], position[chains.before[here]], chains.gap[here]
        if np.count_nonzero(~first) < LEAST_REPEATS:
            continue
        if (
            np.count_nonzero(~first) < LEAST_REPEATS_AGAINST_DECLARED
            and noise.source.get(noise.channels[c]) == "declared"
        ):
            continue  # so few readings show a misfit's own course, not how a declared noise follows itself
        sd = np.sqrt(noise.sigma[c] ** 2 + np.sum(observations.setting_columns[here] ** 2, axis=1))
        columns = design[here] / sd[:, None]
        columns = orthonormal_basis(columns[:, np.any(columns != 0.0, axis=0)])
        y = observations.residual[here] / sd
        joined = np.column_stack([columns, y])

        def cost(value: float) -> float:
            share = np.where(first, 0.0, value**gap)  # noqa: B023 - called before the next turn
            root = np.sqrt(1.0 - share**2)
            white = (joined - share[:, None] * joined[before]) / root[:, None]  # noqa: B023
            triangle = np.linalg.qr(white, mode="r")
            diagonal = np.abs(np.diag(triangle))
            free = len(white) - len(diagonal) + 1
            spread = 2.0 * np.log(diagonal[:-1]).sum() + 2.0 * np.log(root).sum()
            return float(spread + 2.0 * free * np.log(max(diagonal[-1], 1e-300)))

        best = optimize.minimize_scalar(
            cost, bounds=(0.0, LARGEST_CORRELATION), method="bounded", options={"xatol": 0.01}
        )
        # Only what beats no correlation counts, so that a search that ended early claims nothing that is not so
        rho[c] = best.x if cost(float(best.x)) < cost(0.0) - CORRELATION_PRICE else 0.0
    repeats = np.array([noise.source.get(name) == "repeats" for name in noise.channels])
    independent = np.where(repeats, noise.repeats * (1.0 - rho**2) / (1.0 + rho**2), noise.degrees_of_freedom)
    count = np.bincount(observations.channel, minlength=len(rho))
    slow = np.where(rho > 0.0, 2.0 / ((1.0 - rho**2) * np.maximum(count, 1)), 0.0)
    inverse = slow + 1.0 / np.maximum(independent, 1e-300)
    degrees = np.where(inverse > 0.0, 1.0 / np.maximum(inverse, 1e-300), np.inf)
    return replace(noise, rho=rho, degrees_of_freedom=degrees)


def _common_distance(observations: Observations) -> FloatArray:
    """What a distance error of all mounts does to each channel; their scatter is known from their differences alone.

    A hidden effect that is steep in the distance looks like it, and would make mounts seem to scatter by its size.
    """
    here = observations.channel[:, None] == np.arange(len(observations.channels))
    slopes = (observations.distance_slope, observations.distance_curvature)
    return np.concatenate([here * slope[:, None] for slope in slopes], axis=1)


def _with_random(noise: NoiseModel, observations: Observations, chains: Chains, patterns: FloatArray) -> NoiseModel:
    """The noise with the scatter of mounts and runs, by restricted maximum likelihood with weak priors.

    A prior yields where the mounts or runs agree so much better with each other than it assumes that what they show
    alone, with all that so few of them leave open, is a tighter bound.
    """
    whitening = Whitening(observations, noise, chains)
    columns, _ = random_columns(observations, 1.0, np.ones(len(noise.channels)))
    basis = orthonormal_basis(whitening.serial(np.concatenate([patterns, _common_distance(observations)], axis=1)))
    y, z = whitening.serial(observations.residual), whitening.serial(columns)
    y, z = y - basis @ (basis.T @ y), z - basis @ (basis.T @ z)
    values, vectors = np.linalg.eigh(z.T @ z)
    keep = values > 1e-9 * max(float(values[-1]), 1e-300)
    root = np.sqrt(values[keep])[:, None] * vectors[:, keep].T  # of z'z, without its null space
    seen = (vectors[:, keep].T @ (z.T @ y)) / np.sqrt(values[keep])
    mounts = len(np.unique(observations.column("mount")))
    runs = np.array([len(np.unique(observations.column("run")[observations.of(name)])) for name in noise.channels])
    group = np.concatenate([np.zeros(2 * mounts, dtype=int), np.repeat(1 + np.arange(len(runs)), runs)])
    second = np.concatenate([np.zeros(mounts), np.ones(mounts), np.zeros(int(runs.sum()))]).astype(bool)
    prior = np.concatenate([[PRIOR_MOUNT_M], PRIOR_RUN * noise.sigma])
    weight = np.concatenate([[PRIOR_MOUNT_DOF], np.full(len(runs), PRIOR_RUN_DOF)])

    def cost(log_scale: FloatArray) -> float:
        variance = (prior * np.exp(log_scale)) ** 2
        each = np.where(second, 3.0 * variance[0] ** 2, variance[group])
        total = (root * each) @ root.T + np.eye(len(root))
        _, log_determinant = np.linalg.slogdet(total)
        fit = log_determinant + seen @ np.linalg.solve(total, seen)
        return float(fit + np.sum(weight * (2.0 * log_scale + np.exp(-2.0 * log_scale))))

    bounds = [(-4.0, 6.0)] * len(prior)
    best = optimize.minimize(cost, np.zeros(len(prior)), method="L-BFGS-B", bounds=bounds)
    if not best.success:  # rounding can end its line search; Powell's method needs no slope
        best = optimize.minimize(cost, best.x, method="Powell", bounds=bounds)
    scale = prior * np.exp(best.x)
    if not best.success:  # no scatter is taken for smaller than what is assumed before any reading
        scale = np.fmax(scale, prior)
    wide = scale * _student(np.concatenate([[mounts], runs]) - 1.0 + weight)
    assumed = (np.concatenate([[mounts], runs]) - 1.0 < weight) | (not best.success)
    for k in range(len(scale)):
        own, others = (group == k) & ~second, (group != k) & ~second
        beside = (root[:, others] * (scale**2)[group[others]]) @ root[:, others].T + np.eye(len(root))
        alone, alone_wide = _from_differences(root[:, own], seen, beside)
        if alone_wide < wide[k]:
            scale[k], wide[k], assumed[k] = alone, alone_wide, False
    # One run has no offset of its own, nor a re-mount where the file has no mounts
    placed_again = bool("mount" in observations.given or runs.max() > 1)
    absent = np.concatenate([[not placed_again], runs < 2])
    scale[absent], wide[absent] = 0.0, 0.0
    return replace(
        noise,
        mount_m=float(scale[0]),
        run=scale[1:],
        test_mount_m=float(wide[0]),
        test_run=wide[1:],
        mount_assumed=placed_again and bool(assumed[0]),
    )


def _student(degrees_of_freedom: FloatArray) -> FloatArray:
    """Student's quantile over the normal one, at the tests' level."""
    return np.asarray(stats.t.isf(TEST_LEVEL, degrees_of_freedom) / stats.norm.isf(TEST_LEVEL))


def _from_differences(columns: FloatArray, y: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """The scatter of mounts, or runs, as their differences alone show it, and the same as tests use it.

    A difference on which the readings have the information l is estimated with the variance s^2 + 1 / l. The mean of n
    such squares, with Student's quantile for n, bounds what all groups may share; 1 / l of it is the readings' own. The
    columns, of shape (q, groups), are what each group does to readings y of this covariance.
    """
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), np.column_stack([columns, y]))
    _, length, directions = np.linalg.svd(whitened[:, :-1], full_matrices=False)
    length = length[: columns.shape[1] - 1]  # what all groups share is in the patterns
    if not len(length) or length[-1] <= 1e-6 * length[0]:
        return np.inf, np.inf
    shifts = directions[: len(length)] @ (whitened[:, :-1].T @ whitened[:, -1]) / length**2
    read = float(np.mean(length**-2.0))
    total = max(float(np.mean(shifts**2)), read)
    wide = total * float(_student(np.array(len(shifts)))) ** 2
    return float(np.sqrt(total - read)), float(np.sqrt(wide - read))
