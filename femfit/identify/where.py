"""Where a model fails: the channel, what the misfit changes with, and one plain sentence.

The sentence says how large the misfit is, of which sign, and in which part of the measured range. That
part is the box of at most two thresholds that holds the largest share of the squared misfit beyond its share of the
readings: a regression tree of depth two whose best leaf is described.

References
----------
L. Breiman, J. H. Friedman, R. A. Olshen and C. J. Stone, Classification and Regression Trees (Wadsworth, 1984).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, first_best
from femfit.identify.constants import (
    BEYOND_NOISE,
    COVARIATE_SHARE,
    LEAST_SCORE,
    LEFT_BY_SHARE,
    NEXT_TO_NOTHING,
    NOTHING,
    OTHER_SIGN,
    SAME_SHARE,
    SECOND_WORTH,
    THRESHOLDS,
)
from femfit.identify.noise.whitening import NoiseModel, Whitening, orthonormal_basis
from femfit.identify.observations import Observations
from femfit.identify.patterns import Patterns, smooth_patterns
from femfit.identify.words import sentence
from femfit.tables.header import parts_of

_ALIASES = {"elapsed": "order"}
"""Clocks that mean the same to a reader."""


@dataclass(frozen=True)
class Where:
    """Where the model fails."""

    channel: str  # The measured channel with the largest misfit over its noise; empty where nothing fails
    covariates: tuple[str, ...]  # Columns along which the misfit changes, the strongest first
    sentence: str


def where_it_fails(observations: Observations, whitening: Whitening) -> Where:
    """Find the channel with the largest misfit over its noise, its covariates, and a sentence.

    Where mounts and noise could be what makes that channel the worst, it is the one with the most structure instead.

    The structure is the generalised least-squares fit of smooth patterns beside the scatter of mounts and runs. The
    covariates stand in the order in which they explain it; there are none where the misfit is the same everywhere.
    """
    patterns = smooth_patterns(observations)
    columns, residual = whitening.full(patterns.columns), whitening.full(observations.residual)
    smooth = structured_misfit(patterns, columns, residual)
    counts = np.array([max(int(observations.of(name).sum()), 1) for name in observations.channels])
    excess = np.array([_excess(columns[:, patterns.channel == c], residual) for c in range(len(counts))])
    clear = _clearly_worst(observations, whitening.noise)
    worst = first_best((excess / counts).tolist()) if clear is None else clear
    channel = observations.channels[worst]
    clocked = {"order", "time_s"} & set(observations.given)
    without = set[str]() if clocked else {"order", "elapsed"}  # The order of a file's rows is no time
    covariates = _covariates(columns, patterns, worst, residual, smooth, without)
    here, read = observations.of(channel), observations.residual
    if 2.0 * smooth[here] @ read[here] < smooth[here] @ smooth[here]:
        # Where patterns cannot follow a large misfit, they err towards what a mount's error may be
        smooth = structured_misfit(patterns, whitening.serial(patterns.columns), whitening.serial(read))
    return Where(channel, covariates, describe_region(observations, channel, covariates, smooth))


def _clearly_worst(observations: Observations, noise: NoiseModel) -> int | None:
    """The channel whose readings are farthest off, over their noise; None where noise and mounts may be why."""
    count = np.maximum(np.bincount(observations.channel, minlength=len(noise.sigma)), 1)
    square = observations.mean_square(observations.residual) / noise.sigma**2
    mounts = observations.mean_square(observations.distance_slope * noise.mount_m) / noise.sigma**2
    worst = first_best(square.tolist())
    scatter = np.sqrt(2.0 * (1.0 + noise.rho[worst]) / (1.0 - noise.rho[worst]) / count[worst])
    return worst if square[worst] > 1.0 + mounts[worst] + BEYOND_NOISE * scatter else None


def structured_misfit(patterns: Patterns, columns: FloatArray, residual: FloatArray) -> FloatArray:
    """The smooth part, in the readings' units, of recorded minus predicted; columns and residual are whitened."""
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    amplitude = np.linalg.lstsq(columns / size, residual, rcond=1e-8)[0] / size
    return np.asarray(patterns.columns @ amplitude)


def _covariates(
    columns: FloatArray,
    patterns: Patterns,
    channel: int,
    residual: FloatArray,
    smooth: FloatArray,
    without: set[str],
) -> tuple[str, ...]:
    """Covariates in the order in which each adds most to what the ones before explain with their products.

    The gain of a covariate is the geometric mean of two shares: of the structure, and of its excess over noise, mounts
    and runs. The first alone follows the noise, the second alone is blind to what re-mounts look like as well.
    """
    here = np.flatnonzero(patterns.channel == channel)
    rows = np.any(patterns.columns[:, here] != 0.0, axis=1)
    names = sorted(set().union(*(patterns.along[k] for k in here)) - without)
    chosen: list[str] = []

    def explained(among: list[str]) -> FloatArray:
        inside = [k for k in here if patterns.along[k] <= frozenset(among)]
        projection = orthonormal_basis(patterns.columns[np.ix_(rows, inside)]).T @ smooth[rows]
        return np.array([projection @ projection, max(_excess(columns[:, inside], residual), 0.0)])

    total, reached = explained(names), explained([])
    while len(chosen) < len(names):
        gains = {name: explained([*chosen, name]) - reached for name in names if name not in chosen}
        shares = {
            name: float(np.sqrt(np.prod(np.maximum(gain, 0.0) / np.maximum(total, 1e-300))))
            for name, gain in gains.items()
        }
        best = list(shares)[first_best(list(shares.values()))]
        if shares[best] < COVARIATE_SHARE:
            break
        chosen.append(best)
        reached = explained(chosen)
    return tuple(dict.fromkeys(_ALIASES.get(name, name) for name in chosen))


def _excess(columns: FloatArray, residual: FloatArray) -> float:
    """Squared length of the whitened residual along whitened columns, less what noise gives."""
    if not columns.shape[1]:
        return 0.0
    basis = orthonormal_basis(columns)
    along = basis.T @ residual
    return float(along @ along - basis.shape[1])


_PLACES = ("distance_m", "current_A", "frequency_Hz", "branch", "coil_temperature_C", "magnet_temperature_C", "order")
"""Covariates that a threshold is sought along, those of several circuits by their quantity."""

_CHANGING = ("branch", "coil_temperature_C", "magnet_temperature_C", "order")
"""Those of them with which a misfit is said to change where it has no threshold."""


@dataclass(frozen=True, eq=False)
class _Half:
    """One side of a threshold."""

    name: str
    value: float
    above: bool
    inside: BoolArray

    @property
    def digits(self) -> int:
        """How many the threshold has, at most three: 20 mm, not 20.0 mm."""
        return len(f"{abs(self.value):.2e}".split("e")[0].rstrip("0").replace(".", ""))

    @property
    def parts(self) -> tuple[str, str]:
        """The covariate without its circuit, and the circuit of one of several currents."""
        return parts_of(self.name)


def describe_region(observations: Observations, channel: str, covariates: Sequence[str], smooth: FloatArray) -> str:
    """One sentence on a misfit: ``Measured force is 6 % low above 1 A and below 18 mm``.

    The structured part of recorded minus predicted, of shape (M,), says where. The readings themselves say how much;
    the structured part lacks what a re-mount could have done.
    """
    here = observations.of(channel)
    # A relative misfit refers to the prediction, of a Hall output without its quiescent voltage
    quiescent = observations.nominal.hall_quiescent_V if channel == "hall_V" else 0.0
    misfit, base = observations.residual[here], (observations.base - quiescent)[here]
    if np.sum(misfit**2) <= NOTHING**2 * np.sum(base**2):
        return sentence("where", "nothing", channel)
    leading = observations.leading_current
    values = {
        leading if name == "current_A" else name: observations.column(name)[here]
        for name in covariates
        if name in _PLACES
    }
    s = smooth[here] if smooth[here].any() else misfit
    sign = 1.0 if np.sum(s[s > 0.0] ** 2) >= np.sum(s[s < 0.0] ** 2) else -1.0
    # One share of the prediction may be next to all of the misfit, large readings and small ones alike
    remains = float(np.sum((misfit - _share(misfit, base) * base) ** 2))
    share = remains < LEFT_BY_SHARE * np.sum(misfit**2) and _same_in_small_readings(_share, misfit, base)
    halves = [] if share else _region(values, s, sign)
    both = not share and np.sum(s[sign * s < 0.0] ** 2) > OTHER_SIGN * np.sum(s**2)
    rows = np.ones(len(s), dtype=bool)
    if not share:
        rows = np.logical_and.reduce([sign * s > 0.0, *(half.inside for half in halves)])
    relative = share or _is_relative(misfit[rows], base[rows])
    size = _share if relative else _constant
    named = {half.name for half in halves}
    facts = {
        "channel": channel,
        "magnitude": observations.magnitude.get(channel),
        "relative": relative,  # Whether the size is a share of the prediction; else it is in SI
        "size": size(misfit[rows], base[rows]),  # As a share, more is larger in magnitude; in SI, with its sign
        "alike": _same_in_small_readings(size, misfit[rows], base[rows]),
        "halves": halves,
        "both": both,  # Whether it has the other sign elsewhere
        "changing": [name for name in _CHANGING if name in values and name not in named and not share],
    }
    return sentence("where", "region", facts)


def _region(values: Mapping[str, FloatArray], s: FloatArray, sign: float) -> list[_Half]:
    """At most two thresholds, of different covariates; none where no part of the range stands out."""
    weight = np.where(sign * s > 0.0, s**2, 0.0)
    halves = []
    for name, x in values.items():
        levels = np.unique(x[np.isfinite(x)])
        cuts = np.unique(np.linspace(0, len(levels) - 2, max(min(THRESHOLDS, len(levels) - 1), 0)).astype(int))
        for cut in (_round_between(float(levels[k]), float(levels[k + 1])) for k in cuts if len(levels) > 1):
            halves += [_Half(name, cut, True, np.asarray(x > cut)), _Half(name, cut, False, np.asarray(x < cut))]
    if not halves or weight.sum() <= 0.0:
        return []
    inside = np.stack([half.inside for half in halves]).astype(np.float64)
    share = (inside * weight) @ inside.T / weight.sum()
    score = share - inside @ inside.T / len(s)
    score[share < 0.5] = -1.0
    score = np.round(score, 9)  # equal up to rounding: the first
    single = int(np.argmax(np.diag(score)))
    same = np.array([[a.name == b.name for b in halves] for a in halves])
    pair = np.unravel_index(int(np.argmax(np.where(same, -1.0, score))), score.shape)
    if max(score[single, single], score[pair]) < LEAST_SCORE:
        return []
    if score[pair] > score[single, single] + SECOND_WORTH:
        return sorted((halves[int(k)] for k in pair), key=lambda half: half.name)
    return [halves[single]]


def _round_between(low: float, high: float) -> float:
    """The shortest number between two levels."""
    middle = 0.5 * (low + high)
    for digits in range(12):
        rounded = float(f"{middle:.{digits}e}")
        if low < rounded < high:
            return rounded
    return middle


def _same_in_small_readings(size: Callable[[FloatArray, FloatArray], float], s: FloatArray, base: FloatArray) -> bool:
    """Whether the size of a misfit is also that of its small readings."""
    small = np.abs(base) <= np.median(np.abs(base))
    of_all = size(s, base)
    return abs(size(s[small], base[small]) - of_all) < SAME_SHARE * abs(of_all)


def _share(s: FloatArray, base: FloatArray) -> float:
    return float(s @ base) / max(float(base @ base), 1e-300)


def _constant(s: FloatArray, _: FloatArray) -> float:
    return float(np.mean(s))


def _is_relative(s: FloatArray, base: FloatArray) -> bool:
    """Whether a share of the prediction, less than all of it, describes a misfit better than a constant."""
    share, constant = _share(s, base), _constant(s, base)
    nearer = np.sum((s - share * base) ** 2) <= np.sum((s - constant) ** 2)
    # It never changes its sign, but for readings where it is next to nothing (without current)
    counts = np.abs(base) > NEXT_TO_NOTHING * np.abs(base).max(initial=0.0)
    has_one_sign = np.all(base[counts] > 0.0) or np.all(base[counts] < 0.0)
    return bool(has_one_sign and abs(share) < 1.0 and nearer)
