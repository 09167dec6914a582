"""Short windows of a record, and weights that turn their samples into means, mean derivatives and second derivatives.

A window is long enough for its noise to be small beside what effects do, and short enough to see the motion: one and a
half time constants of the falling body, as long as that leaves enough windows and enough samples in each.

With the test function phi(s) = (1 - s^2)^2 over a window of length T centred at c, s = 2 (t - c) / T, and phi and phi'
zero at its ends, integrating by parts moves the derivatives from the data to phi:

    <x> = int phi x dt / Z,   <x'> = -int phi' x dt / Z,   <x''> = int phi'' x dt / Z,   Z = int phi dt.

(1 - s^2)^2 gives <x''> with the least variance for white noise on x.

References
----------
M. Shinbrot, Transactions of the ASME 79 (1957) 579: method of modulating functions.
H. A. Preisig and D. W. T. Rippin, Computers and Chemical Engineering 17 (1993) 1: review of the method.
D. A. Messenger and D. M. Bortz, Journal of Computational Physics 443 (2021) 110525: weak form and its noise.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.identify.series.constants import (
    EXACT_DEGREE,
    LEAST_SAMPLES,
    LEAST_WINDOWS,
    MOST_WINDOWS,
    TIME_CONSTANTS,
    USUAL_SAMPLES,
    WIDEST_GAP,
)
from femfit.identify.series.samples import Samples
from femfit.model.actuator_model import ActuatorModel


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of equal length on the record's clock, none overlapping another."""

    centre_s: FloatArray
    segment: IntArray
    length_s: float


@dataclass(frozen=True, eq=False)
class Weights:
    """Rows of weights, one a window, over N samples."""

    # Weights of <x>, <x'> and <x''>; shape (n, N)
    mean: sparse.csr_array
    slope: sparse.csr_array
    curvature: sparse.csr_array
    valid: BoolArray  # Whether the window holds samples enough and no gap; its rows are zero otherwise; shape (n,)


def window_weights(windows: Windows, time: FloatArray, segment: IntArray, usable: BoolArray) -> Weights:
    """Weights for samples of any spacing, in segments that never fall and in which time grows.

    Trapezoidal, corrected so that the moments up to the fifth are those of the integrals: <x>, <x'> and <x''> of a
    quintic are then exact and consistent with each other.
    """
    powers = np.arange(EXACT_DEGREE + 1)
    even = 1.0 / (powers + 1) - 2.0 / (powers + 3) + 1.0 / (powers + 5)
    moments = np.where(powers % 2 == 0, even / (1.0 - 2.0 / 3.0 + 1.0 / 5.0), 0.0)  # int s^k phi ds / int phi ds
    once, twice = np.append(0.0, moments[:-1]), np.append([0.0, 0.0], moments[:-2])
    wanted = np.stack([moments, powers * once, powers * (powers - 1) * twice], axis=1)
    scale = np.array([1.0, 2.0 / windows.length_s, (2.0 / windows.length_s) ** 2])

    def weigh(_: IntArray, s: FloatArray) -> FloatArray:
        spacing = np.diff(s)
        quadrature = 0.5 * (np.append(spacing, 1.0 - s[-1]) + np.append(1.0 + s[0], spacing))
        bump = (1.0 - s**2) ** 2
        raw = np.stack([bump, 4.0 * s * (1.0 - s**2), 12.0 * s**2 - 4.0], axis=1) * quadrature[:, None] * (15.0 / 16.0)
        basis = np.vander(s, EXACT_DEGREE + 1, increasing=True)
        carried = (quadrature * bump)[:, None] * basis
        raw += carried @ np.linalg.solve(basis.T @ carried, wanted - basis.T @ raw)
        return np.asarray(raw * scale)

    return Weights(*_by_window(windows, time, segment, usable, weigh))


def held_weights(
    windows: Windows, time: FloatArray, segment: IntArray, held: BoolArray
) -> tuple[sparse.csr_array, Weights]:
    """Weights of a balance x' = u with u held from each sample to the next, exact for a piecewise constant phi.

    phi is replaced by its mean over each interval between samples, so that sum of phi (x_next - x) is the integral of
    phi x' to rounding, kinks of x at the samples included; phi is zero where u is not ``held`` from this sample to the
    next one. First come the weights of u, of shape (n, N); then those of the mean of what is smooth (trapezoidal) and
    of x', without a second derivative.
    """

    def weigh(here: IntArray, s: FloatArray) -> FloatArray | None:
        spacing = np.diff(s)
        primitive = s - 2.0 * s**3 / 3.0 + s**5 / 5.0  # of phi
        bump = np.where(held[here[:-1]], np.diff(primitive) / spacing, 0.0)
        area = float(np.sum(bump * spacing))
        if area <= 0.5 * 16.0 / 15.0:
            return None
        share = bump * spacing / area
        jump = (np.append(0.0, bump) - np.append(bump, 0.0)) * (2.0 / windows.length_s / area)
        middle = 0.5 * (np.append(share, 0.0) + np.append(0.0, share))
        return np.stack([np.append(share, 0.0), middle, jump], axis=1)

    driven, mean, slope, valid = _by_window(windows, time, segment, np.ones(len(time), dtype=bool), weigh)
    return driven, Weights(mean, slope, sparse.csr_array(mean.shape), valid)


def _by_window(
    windows: Windows,
    time: FloatArray,
    segment: IntArray,
    usable: BoolArray,
    weigh: Callable[[IntArray, FloatArray], FloatArray | None],
) -> tuple[sparse.csr_array, sparse.csr_array, sparse.csr_array, BoolArray]:
    """Three weights of each sample in each window, and which windows have them; the rows of the others are zero.

    Those in which usable samples stand densely enough, and of which ``weigh`` makes weights (k, 3) of the numbers (k,)
    of these samples and their s.
    """
    half, slack = 0.5 * windows.length_s, 1e-9 * windows.length_s
    row, column, value = [np.zeros(0, dtype=int)], [np.zeros(0, dtype=int)], [np.zeros((0, 3))]
    for k, (number, centre) in enumerate(zip(windows.segment, windows.centre_s, strict=True)):
        first, last = np.searchsorted(segment, [number, number + 1])
        start, stop = first + np.searchsorted(time[first:last], [centre - half - slack, centre + half + slack])
        inside = start + np.flatnonzero(usable[start:stop])
        s = 2.0 * (time[inside] - centre) / windows.length_s
        dense = len(s) >= LEAST_SAMPLES and np.diff(np.concatenate([[-1.0], s, [1.0]])).max() < 2.0 * WIDEST_GAP
        if dense and (weights := weigh(inside, s)) is not None:
            row.append(np.full(len(inside), k))
            column.append(inside)
            value.append(weights)
    places, shape = (np.concatenate(row), np.concatenate(column)), (len(windows.centre_s), len(time))
    mean, slope, curvature = (sparse.csr_array((each, places), shape=shape) for each in np.concatenate(value).T)
    return mean, slope, curvature, np.isin(np.arange(shape[0]), places[0])


def lay_windows(model: ActuatorModel, samples: Samples) -> Windows:
    """Windows of equal length over every stretch of a record, without an impact, at which no path is smooth.

    There is no window where no stretch is long enough.
    """
    time, stretch, usable = samples["time_s"], samples["stretch"], samples["usable"]
    _, first = np.unique(stretch, return_index=True)
    last = np.append(first[1:], len(time)) - 1
    spans, spacing = time[last] - time[first], np.diff(time)[np.diff(stretch) == 0]
    total, usual = float(np.sum(spans)), float(np.median(spacing)) if len(spacing) else 0.0
    pole = 0.0  # Rate at which the body runs away from (or swings about) where it is
    if model.motion is not None:
        pick = np.flatnonzero(usable)[:: max(1, np.count_nonzero(usable) // 500)]
        distance, currents = samples["distance_m"][pick], samples.stacked(samples.currents)[pick]
        stiffness = model.motion.static_gradient(distance) - model.magnetics.force_gradient(distance, currents)
        pole = float(np.sqrt(np.median(np.abs(stiffness)) / model.motion.mass_kg))
    constant = 1.0 / (pole or 100.0)  # of nothing that moves: 10 ms
    length = max(min(TIME_CONSTANTS * constant, total / LEAST_WINDOWS), USUAL_SAMPLES * usual, total / MOST_WINDOWS)
    counts = np.floor(spans / max(length, 1e-300) * (1.0 + 1e-9)).astype(int)
    centre = [start + length * (0.5 + np.arange(n)) for start, n in zip(time[first], counts, strict=True)]
    windows = Windows(np.concatenate(centre), np.repeat(samples["segment"][first], counts), length)
    valid = window_weights(windows, time, samples["segment"], usable & ~samples["touches"]).valid
    return Windows(windows.centre_s[valid], windows.segment[valid], length)


def local_polynomials(
    node_s: FloatArray,
    node_stretch: IntArray,
    time: FloatArray,
    stretch: IntArray,
    centre_s: FloatArray,
    span_s: tuple[float, float],
    degree: int,
) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Weights of value and slope of a local polynomial at n nodes over N samples, two sparse arrays of shape (n, N).

    The samples that count for a node stand around its centre, which is the node itself or before it, from so far behind
    to so far ahead, by the weight (1 - s^2)^2; more, on the same sides, where there are too few of them. All stand in
    the node's stretch: no path is smooth across an impact. Where it begins, what lacks behind is taken ahead.
    """
    behind_s, ahead_s = span_s
    # One clock for all stretches, far enough apart that no node sees another stretch
    span = float(time.max() - time.min()) + 10.0 * (behind_s + ahead_s)
    clock, asked = time - time.min() + span * stretch, centre_s - time.min() + span * node_stretch
    least, slack = 2 * (degree + 1), 1e-9 * (behind_s + ahead_s)
    opens, closes = (np.searchsorted(stretch, node_stretch, side) for side in ("left", "right"))
    first = np.searchsorted(clock, asked - behind_s - slack)
    last = np.searchsorted(clock, np.maximum(asked + ahead_s, clock[opens] + behind_s) + slack)
    few = last - first < least
    shift = np.where(ahead_s > 0.0, least // 2, least)
    begin = np.searchsorted(clock, asked + slack) - shift
    begin = np.clip(begin, opens, np.maximum(closes - least, opens))
    first, last = np.where(few, begin, first), np.where(few, np.minimum(begin + least, closes), last)
    picked = first[:, None] + np.arange(int((last - first).max()))
    inside = picked < last[:, None]
    picked = np.minimum(picked, len(clock) - 1)
    distance = clock[picked] - asked[:, None]
    farthest = np.abs(np.where(inside, distance, 0.0)).max(axis=1, keepdims=True)
    width = np.maximum(max(behind_s, ahead_s), 1.01 * farthest)
    weight = np.where(inside, (1.0 - (distance / width) ** 2) ** 2, 0.0)
    s = (distance - (node_s - centre_s)[:, None]) / width
    basis = s[:, :, None] ** np.arange(degree + 1)
    carried = weight[:, :, None] * basis
    gram = np.einsum("nka,nkb->nab", carried, basis)
    unit = np.zeros((len(asked), degree + 1, 2))
    unit[:, 0, 0], unit[:, 1, 1] = 1.0, 1.0 / width[:, 0]
    value = carried @ np.linalg.solve(gram, unit)
    places, shape = (np.nonzero(inside)[0], picked[inside]), (len(asked), len(time))
    level, slope = (sparse.csr_array((value[:, :, j][inside], places), shape=shape) for j in (0, 1))
    return level, slope
