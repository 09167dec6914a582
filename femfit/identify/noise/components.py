"""Estimates the noise of a campaign: from repeats where there are any, else as declared.

The scatter of a reading comes from repeats of one setting, after each mount's position, each run's offset and what
temperature and time do were removed; its correlation along a run and the scatter of mounts and runs from what a smooth
surface leaves. Nothing here looks at an effect, and a hidden one does not widen the noise: it is the same in every
repeat.

References
----------
S. R. Searle, G. Casella and C. E. McCulloch, Variance Components (Wiley, 1992), chapters 6 and 8 (restricted maximum
likelihood, prior scale).
"""

from dataclasses import replace

import numpy as np
from scipy import optimize, stats

from femfit.core.arrays import FloatArray
from femfit.identify.comparison.patterns import drift_patterns, smooth_patterns
from femfit.identify.noise.whitening import Chains, NoiseModel, Whitening, chains_of, orthonormal_basis, random_columns
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.repeats import pure_error, repeat_cells

_PRIOR_MOUNT_M, _PRIOR_MOUNT_DOF = 20e-6, 6.0
"""A body put back by hand against a stop comes back to about this; counts like so many mounts."""

_PRIOR_RUN, _PRIOR_RUN_DOF = 0.1, 4.0
"""A run's offset over the channel's sigma, and the same."""

_LEAST_REPEATS = 12
"""Degrees of freedom from which repeats tell a channel's noise."""

_LARGEST_RHO = 0.95
_TEST_LEVEL = 2.5e-4
"""One tail at which a test's normal quantile is replaced by Student's, for scatter known from few mounts or runs."""


def estimate_noise(observations: Observations) -> NoiseModel | None:
    """The noise model of a campaign.

    Returns
    -------
    NoiseModel or None
        None where neither repeats nor a sidecar tell the noise of any channel.
    """
    sigma, degrees, source = _scatter(observations)
    if not np.isfinite(sigma).any():
        return None
    channels = len(observations.channels)
    chains = chains_of(observations)
    noise = NoiseModel(
        channels=observations.channels,
        sigma=np.where(np.isfinite(sigma), sigma, 1e6 * np.nanmax(sigma)),
        rho=np.zeros(channels),
        mount_m=_PRIOR_MOUNT_M,
        run=np.zeros(channels),
        degrees_of_freedom=degrees,
        repeats=degrees,
        source=source,
        test_mount_m=_PRIOR_MOUNT_M,
        test_run=np.zeros(channels),
    )
    patterns = smooth_patterns(observations).columns
    noise = _with_serial(noise, observations, chains, patterns)
    return _with_random(noise, observations, chains, patterns)


def _scatter(observations: Observations) -> tuple[FloatArray, FloatArray, dict[str, str]]:
    """Sigma, its degrees of freedom and its source per channel; NaN where nothing tells it."""
    count = len(observations.channels)
    sigma, degrees, source = np.full(count, np.nan), np.zeros(count), {}
    cells = repeat_cells(observations)
    nuisance = np.concatenate(
        [random_columns(observations, 1.0, np.ones(count))[0], drift_patterns(observations).columns], axis=1
    )
    residual = observations.residual
    for c, name in enumerate(observations.channels):
        here = observations.channel == c
        square, dof = pure_error(residual[here], cells[here], nuisance[here])
        if name in observations.declared_noise:
            sigma[c], degrees[c], source[name] = observations.declared_noise[name], np.inf, observations.noise_source
        if dof >= (4 * _LEAST_REPEATS if name in source else _LEAST_REPEATS) and square > 0.0:
            sigma[c], degrees[c], source[name] = np.sqrt(square / dof), dof, "repeats"
    return sigma, degrees, source


def _with_serial(noise: NoiseModel, observations: Observations, chains: Chains, patterns: FloatArray) -> NoiseModel:
    """The noise with the correlation of successive readings: per channel the one of largest restricted likelihood.

    Readings that follow each other by the autocorrelation rho tell the variance only as well as
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
        if np.count_nonzero(~first) < _LEAST_REPEATS:
            continue
        columns = design[here]
        columns = orthonormal_basis(columns[:, np.any(columns != 0.0, axis=0)])
        y = observations.residual[here] / noise.sigma[c]
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

        best = optimize.minimize_scalar(cost, bounds=(0.0, _LARGEST_RHO), method="bounded", options={"xatol": 0.01})
        rho[c] = best.x if cost(float(best.x)) < cost(0.0) - 0.5 else 0.0
    repeats = np.array([noise.source.get(name) == "repeats" for name in noise.channels])
    independent = np.where(repeats, noise.repeats * (1.0 - rho**2) / (1.0 + rho**2), noise.degrees_of_freedom)
    count = np.bincount(observations.channel, minlength=len(rho))
    slow = np.where(rho > 0.0, 2.0 / ((1.0 - rho**2) * np.maximum(count, 1)), 0.0)
    inverse = slow + 1.0 / np.maximum(independent, 1e-300)
    degrees = np.where(inverse > 0.0, 1.0 / np.maximum(inverse, 1e-300), np.inf)
    return replace(noise, rho=rho, degrees_of_freedom=degrees)


def _common_distance(observations: Observations) -> FloatArray:
    """What a distance error of all mounts does to each channel; their scatter is told by their differences alone.

    A hidden effect that is steep in the distance looks like it, and would make mounts seem to scatter by its size.
    """
    here = observations.channel[:, None] == np.arange(len(observations.channels))
    slopes = (observations.distance_slope, observations.distance_curvature)
    return np.concatenate([here * slope[:, None] for slope in slopes], axis=1)


def _with_random(noise: NoiseModel, observations: Observations, chains: Chains, patterns: FloatArray) -> NoiseModel:
    """The noise with the scatter of mounts and runs, by restricted maximum likelihood with weak priors."""
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
    prior = np.concatenate([[_PRIOR_MOUNT_M], _PRIOR_RUN * noise.sigma])
    weight = np.concatenate([[_PRIOR_MOUNT_DOF], np.full(len(runs), _PRIOR_RUN_DOF)])

    def cost(log_scale: FloatArray) -> float:
        variance = (prior * np.exp(log_scale)) ** 2
        each = np.where(second, 3.0 * variance[0] ** 2, variance[group])
        total = (root * each) @ root.T + np.eye(len(root))
        _, log_determinant = np.linalg.slogdet(total)
        fit = log_determinant + seen @ np.linalg.solve(total, seen)
        return float(fit + np.sum(weight * (2.0 * log_scale + np.exp(-2.0 * log_scale))))

    best = optimize.minimize(cost, np.zeros(len(prior)), method="L-BFGS-B", bounds=[(-4.0, 6.0)] * len(prior)).x
    scale = prior * np.exp(best)
    many = np.concatenate([[mounts], runs]) - 1.0 + weight
    wide = stats.t.isf(_TEST_LEVEL, many) / stats.norm.isf(_TEST_LEVEL)
    single = np.concatenate([[False], runs < 2])  # one run has no offset of its own
    scale[single] = 0.0
    return replace(
        noise,
        mount_m=float(scale[0]),
        run=scale[1:],
        test_mount_m=float(wide[0] * scale[0]),
        test_run=wide[1:] * scale[1:],
    )
