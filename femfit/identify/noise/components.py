"""Estimates the noise of a campaign: its readings', its runs' and its mounts'; docs/explanation/noise.md has the model.

The scatter of a reading comes from repeats of one setting and from what was declared, weighted by their degrees of
freedom; from a guess where there is neither. Nothing here looks at an effect, and a hidden one does not widen the
noise: it is the same in every repeat. Simulated campaigns draw their noise from the same model.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

from femfit.core.numerics import FloatArray
from femfit.identify.constants import (
    EXACT,
    LEAST_REPEATS,
    LEAST_REPEATS_AGAINST_DECLARED,
    PRIOR_MOUNT_M,
    PRIOR_RUN,
    PRIOR_WEIGHT,
    SAME_READING,
    TEST_LEVEL,
    UNKNOWN_CHANNEL,
)
from femfit.identify.noise.contrasts import ChannelDesign, Contrasts, restricted_estimate, rho_of
from femfit.identify.noise.scatter import (
    Scatter,
    contradicts,
    guessed_scatter,
    known_scatter,
    repeated_readings,
)
from femfit.identify.noise.whitening import NoiseModel, random_effects
from femfit.identify.observations import Observations
from femfit.identify.settings import quantisation_step
from femfit.tables.measurement import OF_RUNS


def estimate_noise(observations: Observations) -> NoiseModel | None:
    """The noise model of a campaign.

    None where neither repeats nor a declaration say the noise of any channel, and it cannot be guessed either.
    """
    names, constant = observations.channels, never_varying(observations)
    scatter = [known_scatter(observations, c, name in constant) for c, name in enumerate(names)]
    if not any(of_channel.design for of_channel in scatter):
        scatter = [guessed_scatter(observations, c) for c in range(len(names))]
    designs = {c: of_channel.design for c, of_channel in enumerate(scatter) if of_channel.design is not None}
    if not designs:
        return None
    rho, contrasts = np.zeros(len(names)), {}
    for c, design in designs.items():
        if not design.cells and not _is_noise(scatter[c], design):  # but a misfit
            contrasts[c] = Contrasts(0.0, 0.0, np.zeros(0), np.zeros((0, design.random.shape[1])))
            continue
        # Too few readings that follow each other do not say how they are correlated
        follows = int(np.count_nonzero(~design.chain.first))
        k = design.best_rho() if min(follows, design.free) >= LEAST_REPEATS else 0
        rho[c], contrasts[c] = rho_of(k), design.contrasts(k)
        if not scatter[c].repeats:  # what smooth patterns leave is never taken for the noise of a reading
            contrasts[c] = Contrasts(0.0, 0.0, contrasts[c].along, contrasts[c].columns)
    sigma, variances = _variances(observations, scatter, contrasts)
    for c in range(len(names)):
        if c not in designs:
            largest = float(np.abs(observations.value[observations.channel == c]).max())
            sigma[c] = UNKNOWN_CHANNEL * (largest or 1.0)
    return NoiseModel(
        channels=names,
        sigma=sigma,
        rho=rho,
        degrees_of_freedom=_degrees_of_freedom(observations, scatter, rho),
        repeats=np.array([of_channel.repeats for of_channel in scatter]),
        source={names[c]: scatter[c].source for c in designs},
        never_varying=tuple(constant),
        **variances,
    )


def never_varying(observations: Observations) -> list[str]:
    """Channels whose readings are the same, but for the rounding of a float, wherever a setting was repeated."""
    names = []
    for c, name in enumerate(observations.channels):
        sorting, start, _ = repeated_readings(observations)[c]
        if len(sorting) - len(start) < LEAST_REPEATS:
            continue
        value = observations.value[sorting]
        spread = np.maximum.reduceat(value, start) - np.minimum.reduceat(value, start)
        if spread.max() <= SAME_READING * float(np.abs(observations.value[observations.channel == c]).max()):
            names.append(name)
    return names


def _is_noise(scatter: Scatter, design: ChannelDesign) -> bool:
    """Whether smooth patterns leave noise: enough readings to say it, and no more than a declared noise makes.

    Else it is a misfit, which says nothing of how readings follow each other, nor of runs and mounts.
    """
    if design.free < LEAST_REPEATS_AGAINST_DECLARED:
        return False
    ratio = design.contrasts(0).square / design.free / scatter.prior**2
    return ratio <= 1.0 or not contradicts(ratio, design.free, scatter.weight)


def _variances(
    observations: Observations, scatter: Sequence[Scatter], contrasts: dict[int, Contrasts]
) -> tuple[FloatArray, dict[str, Any]]:
    """Standard deviations of readings; and those of mounts, runs and stops as the noise model has them."""
    judged, random, names = list(contrasts), random_effects(observations), observations.channels
    sigma = np.array([of_channel.prior for of_channel in scatter])
    # Of the variances only those that several mounts or runs, in a channel of known noise, have
    groups = range(2 + len(names))
    moved = [c for c in judged if observations.distance_slope[observations.channel == c].any()]
    used = [g for g in groups if random.differences[g] > 0.0 and (g - 1 in judged or (g in {0, groups[-1]} and moved))]
    place = np.array([used.index(g) if g in used else -1 for g in groups])
    columns = place[random.group] >= 0
    declared, distance_m = observations.declared_noise, observations.declared_noise.get("distance_m")
    mount = distance_m or PRIOR_MOUNT_M
    # A stop is assumed to make, in the channel which shows it most, what runs are assumed to differ by
    slopes = [np.sqrt(np.mean(observations.distance_slope[observations.channel == c] ** 2)) / sigma[c] for c in moved]
    stop = distance_m or PRIOR_RUN / float(max(slopes, default=np.inf))
    declared_run = np.array([declared.get(OF_RUNS + name, np.nan) for name in names])
    offsets = np.where(np.isnan(declared_run), PRIOR_RUN * sigma, declared_run)
    scale = np.array([mount, *offsets, stop])[used] ** 2
    is_declared = np.array([False, *np.isfinite(declared_run), False])[used]
    group, second = place[random.group[columns]], random.second[columns]
    parts = [
        Contrasts(contrasts[c].square, contrasts[c].free, contrasts[c].along, contrasts[c].columns[:, columns])
        for c in judged
    ]
    # Without repeats nothing may move a declared noise: what a misfit differs by from run to run would
    start, trust = sigma[judged] ** 2, np.array([scatter[c].weight if scatter[c].repeats else EXACT for c in judged])

    scale, u = np.concatenate([scale, start]), len(used)
    none = np.concatenate([np.zeros(u), trust])
    alone = restricted_estimate(parts, group, second, scale, none)
    # How many differences of mounts, and of runs, are left once fixed effects, drifts above all, are taken out
    scaled = np.concatenate([of_channel.columns / s for of_channel, s in zip(parts, np.sqrt(start), strict=True)])
    ranks = [np.linalg.matrix_rank(scaled[:, (group == k) & ~second], rtol=1e-6) for k in range(u)]
    n = np.minimum(np.array(ranks, dtype=np.float64), random.differences[used])
    # A difference of which readings alone tell with the variance b tells of v with the variance 2 (v + b)^2
    shown = np.maximum(np.sqrt(n * alone.spread_alone[:u] / 2.0), alone.variance[:u])
    read = shown - alone.variance[:u]
    against = [
        not declared and bool(k) and alone.converged and contradicts(float(s / (a + b)), float(k), PRIOR_WEIGHT)
        for s, a, b, k, declared in zip(shown, scale[:u], read, n, is_declared, strict=True)
    ]
    weight = np.concatenate([np.where(is_declared, EXACT, np.where(against, 0.0, PRIOR_WEIGHT)), trust])
    # From what the readings say alone: a large offset of runs is not to be taken for noise of readings on the way
    estimate = restricted_estimate(parts, group, second, scale, weight, np.maximum(alone.variance, scale))
    variance = estimate.variance[:u].copy()
    if not estimate.converged:  # no scatter is taken for smaller than what is assumed before any reading
        variance = np.maximum(variance, scale[:u])
    degrees = np.maximum(estimate.degrees_of_freedom[:u], PRIOR_WEIGHT)
    tests = np.where(against, shown * _student(np.maximum(n, 1.0)) - read, variance * _student(degrees))
    assumed = ~np.array(against, dtype=bool) & (degrees < 2.0 * PRIOR_WEIGHT)
    result, wide = np.zeros(len(groups)), np.zeros(len(groups))
    result[used], wide[used] = np.sqrt(variance), np.sqrt(np.maximum(tests, variance))
    sigma[judged] = np.sqrt(estimate.variance[u:])
    for c in judged:
        step = quantisation_step(observations.value[observations.channel == c])
        sigma[c] = max(sigma[c], step / np.sqrt(12.0))
    return sigma, {
        "mount_m": float(result[0]),
        "test_mount_m": float(wide[0]),
        "mount_assumed": bool(0 in used and assumed[0] and distance_m is None),
        "run": result[1:-1],
        "test_run": wide[1:-1],
        "stop_m": float(result[-1]),
        "test_stop_m": float(wide[-1]),
    }


def _student(degrees_of_freedom: FloatArray) -> FloatArray:
    """Square of Student's quantile over the normal one, at the tests' level."""
    return np.asarray((stats.t.isf(TEST_LEVEL, degrees_of_freedom) / stats.norm.isf(TEST_LEVEL)) ** 2)


def _degrees_of_freedom(observations: Observations, scatter: Sequence[Scatter], rho: FloatArray) -> FloatArray:
    """Degrees of freedom of each channel's noise, counted in independent readings; infinite where it is known.

    Repeats that follow each other by the correlation rho say the variance only as well as (1 - rho^2) / (1 + rho^2)
    times as many independent ones; and slow patterns have (1 + rho) / (1 - rho) of that variance, which rho's own
    uncertainty, (1 - rho^2) / n, makes uncertain by 4 / ((1 - rho^2) n) in relative variance.
    """
    count = np.bincount(observations.channel, minlength=len(rho))
    declared = np.array([of_channel.weight for of_channel in scatter])
    repeats = np.array([of_channel.repeats for of_channel in scatter])
    independent = declared + repeats * (1.0 - rho**2) / (1.0 + rho**2)
    independent[declared >= EXACT] = np.inf
    slow = np.where(rho > 0.0, 2.0 / ((1.0 - rho**2) * np.maximum(count, 1)), 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / (slow + 1.0 / np.maximum(independent, 1e-300)))
