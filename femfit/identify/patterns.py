"""Smooth patterns over a bench's settings: what structure a residual could have, whatever its cause.

Per channel: Legendre polynomials in log distance and current up to a total degree, finer ones in either alone, coarse
ones times the branch, temperatures, times and speeds with their first products. They are what the lack-of-fit test
looks for.

References
----------
D. R. Cox and D. V. Hinkley, Theoretical Statistics (Chapman and Hall, 1974), section 3.4: tests against a space of
alternatives.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from operator import itemgetter

import numpy as np
from numpy.polynomial.legendre import legvander

from femfit.core.numerics import FloatArray, IntArray, even_scale
from femfit.effects.conditions import TEMPERATURES
from femfit.identify.constants import BRANCH_DEGREE, DEGREE, FINE_DEGREE, FINER, LEAST_READINGS, LEAST_SPREAD_C
from femfit.identify.observations import VOLTAGE_BALANCE, Observations, once_for_settings


@dataclass(frozen=True, eq=False)
class Patterns:
    """Smooth patterns of all channels."""

    columns: FloatArray  # Each zero outside of its channel; shape (M, k)
    channel: IntArray  # Channel of each column; shape (k,)
    degree: IntArray  # How fine each column is: its total degree in all covariates; shape (k,)
    along: tuple[frozenset[str], ...]  # Covariates that each column changes with


Labelled = tuple[FloatArray, int, frozenset[str]]
"""(column, degree, covariates)"""


@once_for_settings
def smooth_patterns(observations: Observations) -> Patterns:
    """The patterns of all channels: of distance, current and branch, of temperatures, speeds and time.

    They are independent of each other within rounding, and at most a third of each channel's readings.
    """
    chosen: list[Labelled] = []
    channel: list[int] = []
    for c in range(len(observations.channels)):
        of_channel = np.flatnonzero(observations.channel == c)
        if len(of_channel) < LEAST_READINGS:
            continue
        # Few readings have room for the broad ones alone, of every covariate
        labelled = sorted(_candidates(observations, of_channel), key=itemgetter(1))
        columns = np.stack([column for column, _, _ in labelled], axis=1)
        # Those that the ones before them do not span to 1e-6
        triangle = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), mode="r")
        keep = np.flatnonzero(np.abs(np.diag(triangle)) > 1e-6)[: max(1, len(of_channel) // 3)]
        channel += [c] * len(keep)
        chosen += [labelled[k] for k in keep]
    wide = np.zeros((len(observations.value), len(chosen)))
    for k, (column, _, _) in enumerate(chosen):
        wide[observations.channel == channel[k], k] = column
    return Patterns(
        columns=wide,
        channel=np.array(channel, dtype=int),
        degree=np.array([degree for _, degree, _ in chosen], dtype=int),
        along=tuple(names for _, _, names in chosen),
    )


def own_misfit_columns(observations: Observations) -> FloatArray | None:
    """The model's misfit to its own table as smooth patterns, each by one standard deviation; None where it has none.

    Four kinds of misfit, each with the tolerance's variance at a reading on average, since nobody knows which it is: as
    large everywhere or a share of the prediction, and all patterns alike or finer ones smaller. All four are granted,
    so that a reading has twice the tolerance, as by ``OWN_MISFIT``.

    References
    ----------
    M. C. Kennedy and A. O'Hagan, Journal of the Royal Statistical Society B 63 (2001) 425: model discrepancy.
    """
    if not observations.tolerance.any():
        return None
    patterns = smooth_patterns(observations)
    finer = FINER ** (2.0 * patterns.degree)
    readings, number, total = (
        np.bincount(columns, weights, len(observations.channels))[patterns.channel]
        for columns, weights in ((observations.channel, None), (patterns.channel, None), (patterns.channel, finer))
    )
    weight = np.sqrt(finer / total + 1.0 / number)
    prediction = observations.value - observations.residual
    kinds = patterns.columns, patterns.columns * prediction[:, None]
    scaled = [
        columns * weight / np.maximum(np.sqrt(np.sum(columns**2, axis=0) / readings), 1e-300) for columns in kinds
    ]
    return np.asarray(observations.tolerance[:, None] * np.concatenate(scaled, axis=1))


def _candidates(observations: Observations, of_channel: IntArray) -> Iterator[Labelled]:
    """The patterns of a channel with these readings, first of the settings."""
    x = scaled_to_one(even_scale(observations.column("distance_m")[of_channel]))
    y = scaled_to_one(observations.column("current_A")[of_channel])
    yield from _tensor(x, y, DEGREE)
    finest = DEGREE if observations.in_motion else FINE_DEGREE  # a record has no stage with a screw
    for z, name in ((x, "distance_m"), (y, "current_A")):
        columns = _polynomials(z, finest)
        yield from ((columns[:, k], k, frozenset({name})) for k in range(DEGREE + 1, columns.shape[1]))
    for name in observations.currents:  # further circuits: their square and what they do with the others
        z = observations.column(name)[of_channel]
        if name != observations.leading_current and np.ptp(z) > 0.0:
            yield from _beside(name, z, x, y, ((1, 0, 0), (2, 0, 0), (1, 1, 0), (1, 0, 1), (2, 1, 0)))
    if observations.of_impedances:
        columns = _polynomials(scaled_to_one(observations.setting("frequency_Hz")[of_channel]), FINE_DEGREE)
        for k in range(1, columns.shape[1]):
            for pattern, degree, names in _tensor(x, y, max(DEGREE - k, 0)):
                yield columns[:, k] * pattern, k + degree, names | {"frequency_Hz"}
    branch = observations.column("branch")[of_channel]
    if np.ptp(branch) > 0.0:
        for column, degree, names in _tensor(x, y, BRANCH_DEGREE):
            yield branch * column, 1 + degree, names | {"branch"}
    yield from _drifting(observations, of_channel, x, y)


def _drifting(observations: Observations, of_channel: IntArray, x: FloatArray, y: FloatArray) -> Iterator[Labelled]:
    """Those of temperatures, speeds and time beside scaled distance and current."""
    for name in TEMPERATURES:
        t = observations.column(name)[of_channel]
        if np.isfinite(t).all() and t.std() > LEAST_SPREAD_C:
            yield from _beside(name, t, x, y, ((1, 0, 0), (2, 0, 0), (1, 1, 0), (1, 0, 1), (1, 1, 1), (1, 2, 0)))
    # A voltage balance is made of the very rates, noise and all: where a motion is repeated, they less a function of
    # distance, current and branch are that noise
    of_voltage = observations.channels[observations.channel[of_channel[0]]].startswith(VOLTAGE_BALANCE)
    motion = () if of_voltage or not observations.in_motion else ("velocity_m_s", "current_rate_A_s")
    clocks = ("order", "elapsed") if observations.clocked else ()  # the order of a file's rows is no time
    for name in (*motion, *clocks):
        t = observations.column(name)[of_channel]
        if np.ptp(t) > 0.0:
            yield from _beside(name, t, x, y, ((1, 0, 0), (2, 0, 0), (3, 0, 0), (1, 1, 0), (1, 0, 1)))


def _beside(
    name: str, z: FloatArray, x: FloatArray, y: FloatArray, powers: tuple[tuple[int, int, int], ...]
) -> list[Labelled]:
    """Powers (a, b, c) of a further covariate z, scaled, times those of distance x and current y."""
    z = scaled_to_one(z)
    return [
        (z**a * x**b * y**c, a + b + c, frozenset([name, *["distance_m"] * (b > 0), *["current_A"] * (c > 0)]))
        for a, b, c in powers
    ]


def _tensor(x: FloatArray, y: FloatArray, degree: int) -> list[Labelled]:
    return products(_polynomials(x, degree), _polynomials(y, degree), degree)


def _polynomials(x: FloatArray, degree: int) -> FloatArray:
    """Legendre polynomials up to a degree, as far as so many levels tell them apart; shape (n, degrees)."""
    return np.asarray(legvander(x, min(degree, len(np.unique(np.round(x, 6))) - 1)))


def products(in_x: FloatArray, in_y: FloatArray, degree: int) -> list[Labelled]:
    """Products of polynomials in distance and current up to a total degree."""
    powers = product(range(in_x.shape[1]), range(in_y.shape[1]))
    return [
        (in_x[:, a] * in_y[:, b], a + b, frozenset(["distance_m"] * (a > 0) + ["current_A"] * (b > 0)))
        for a, b in sorted(powers, key=sum)
        if a + b <= degree
    ]


def scaled_to_one(x: FloatArray) -> FloatArray:
    """Scaled to -1..1; zeros where it does not vary."""
    low, high = float(x.min()), float(x.max())
    return np.asarray((2.0 * x - low - high) / (high - low)) if high > low else np.zeros_like(x)


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
