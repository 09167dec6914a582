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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.identify.constants import (
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
    wanted = np.stack(
        [
            moments[: EXACT_DEGREE + 1],
            powers * np.concatenate([[0.0], moments[:EXACT_DEGREE]]),
            powers * (powers - 1) * np.concatenate([[0.0, 0.0], moments[: EXACT_DEGREE - 1]]),
        ],
        axis=1,
    )
    scale = np.array([1.0, 2.0 / windows.length_s, (2.0 / windows.length_s) ** 2])
    entries: list[_Entry] = []
    for k, here, s in _covered(windows, time, segment, usable):
        spacing = np.diff(s)
        quadrature = 0.5 * (np.append(spacing, 1.0 - s[-1]) + np.append(1.0 + s[0], spacing))
        bump = (1.0 - s**2) ** 2
        raw = np.stack([bump, 4.0 * s * (1.0 - s**2), 12.0 * s**2 - 4.0], axis=1) * quadrature[:, None] * (15.0 / 16.0)
        basis = np.vander(s, EXACT_DEGREE + 1, increasing=True)
        carried = (quadrature * bump)[:, None] * basis
        raw += carried @ np.linalg.solve(basis.T @ carried, wanted - basis.T @ raw)
        entries.append((k, here, raw * scale))
    return Weights(*_arrays(entries, (len(windows.centre_s), len(time))))


def held_weights(
    windows: Windows, time: FloatArray, segment: IntArray, usable_samples: BoolArray, held: BoolArray
) -> tuple[sparse.csr_array, sparse.csr_array, sparse.csr_array, BoolArray]:
    """Weights of a balance x' = u with u held from each sample to the next, exact for a piecewise constant phi.

    phi is replaced by its mean over each interval between known samples, so that sum of phi (x_next - x) is the
    integral of phi x' to rounding, kinks of x at the samples included; phi is zero where u is not ``held`` from this
    known sample to the next one. The weights, of shape (n, N), are for u, for the mean of what is smooth (trapezoidal),
    and for x; then comes the validity of each window.
    """
    entries: list[_Entry] = []
    for k, here, s in _covered(windows, time, segment, usable_samples):
        spacing, usable = np.diff(s), held[here[:-1]]
        primitive = s - 2.0 * s**3 / 3.0 + s**5 / 5.0  # of phi
        bump = np.where(usable, np.diff(primitive) / spacing, 0.0)
        area = float(np.sum(bump * spacing))
        if area <= 0.5 * 16.0 / 15.0:
            continue
        share = bump * spacing / area
        jump = (np.append(0.0, bump) - np.append(bump, 0.0)) * (2.0 / windows.length_s / area)
        middle = 0.5 * (np.append(share, 0.0) + np.append(0.0, share))
        entries.append((k, here, np.stack([np.append(share, 0.0), middle, jump], axis=1)))
    return _arrays(entries, (len(windows.centre_s), len(time)))


_Entry = tuple[int, IntArray, FloatArray]
"""A window's number, the k samples that have a weight in it, and their three weights, (k, 3)."""


def _arrays(
    entries: Sequence[_Entry], shape: tuple[int, int]
) -> tuple[sparse.csr_array, sparse.csr_array, sparse.csr_array, BoolArray]:
    """The three arrays of weights, and which windows have an entry; the rows of the others are zero."""
    windows = [k for k, _, _ in entries]
    row = np.repeat(windows, [len(here) for _, here, _ in entries]).astype(int)
    column = np.concatenate([np.zeros(0, dtype=int), *(here for _, here, _ in entries)])
    value = np.concatenate([np.zeros((0, 3)), *(values for _, _, values in entries)])
    first, second, third = (sparse.csr_array((weights, (row, column)), shape=shape) for weights in value.T)
    return first, second, third, np.isin(np.arange(shape[0]), windows)


def _covered(
    windows: Windows, time: FloatArray, segment: IntArray, usable: BoolArray
) -> Iterator[tuple[int, IntArray, FloatArray]]:
    """Of each window in which known samples stand densely enough its number, these samples, and their s."""
    half, slack = 0.5 * windows.length_s, 1e-9 * windows.length_s
    for k, (number, centre) in enumerate(zip(windows.segment, windows.centre_s, strict=True)):
        first, last = np.searchsorted(segment, [number, number + 1])
        start, stop = first + np.searchsorted(time[first:last], [centre - half - slack, centre + half + slack])
        here = start + np.flatnonzero(usable[start:stop])
        s = 2.0 * (time[here] - centre) / windows.length_s
        if len(s) >= LEAST_SAMPLES and np.diff(np.concatenate([[-1.0], s, [1.0]])).max() < 2.0 * WIDEST_GAP:
            yield k, here, s


def lay_windows(model: ActuatorModel, samples: Samples) -> Windows:
    """Windows of equal length over every stretch of a record, without an impact, at which no path is smooth.

    There is no window where no stretch is long enough.
    """
    time, stretch, usable = samples.time, samples.stretch, samples.usable
    _, first = np.unique(stretch, return_index=True)
    last = np.append(first[1:], len(time)) - 1
    spans, spacing = time[last] - time[first], np.diff(time)[np.diff(stretch) == 0]
    total, usual = float(np.sum(spans)), float(np.median(spacing)) if len(spacing) else 0.0
    pole = _pole(model, np.nan_to_num(samples.columns["distance_m"])[usable], samples.current[usable])
    length = max(min(TIME_CONSTANTS / pole, total / LEAST_WINDOWS), USUAL_SAMPLES * usual, total / MOST_WINDOWS)
    counts = np.floor(spans / max(length, 1e-300) * (1.0 + 1e-9)).astype(int)
    centre = [start + length * (0.5 + np.arange(n)) for start, n in zip(time[first], counts, strict=True)]
    windows = Windows(np.concatenate(centre), np.repeat(samples.segment[first], counts), length)
    valid = window_weights(windows, time, samples.segment, usable & ~samples.touches).valid
    return Windows(windows.centre_s[valid], windows.segment[valid], length)


def _pole(model: ActuatorModel, distance: FloatArray, current: FloatArray) -> float:
    """Rate at which the body runs away from (or swings about) where it is, in 1/s; 100 where nothing moves."""
    if model.motion is None or not len(distance):
        return 100.0
    pick = slice(None, None, max(1, len(distance) // 500))
    gradient = model.magnetics.force_gradient(distance[pick], current[pick].reshape(len(distance[pick]), -1))
    stiffness = model.motion.static_gradient(distance[pick]) - gradient
    return float(np.sqrt(np.median(np.abs(stiffness)) / model.motion.mass_kg)) or 100.0
