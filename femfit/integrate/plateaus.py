"""A bench record's plateaus, and the flux linkage on each from the coil voltage.

The offset is the mean voltage of a settled plateau: P. Arpaia et al., Sensors 22 (2022) 182, section 3; F. Fiorillo,
Characterization and Measurement of Magnetic Materials (Elsevier, 2004), section 5.1 (integrator drift).
"""

import itertools
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray, IntArray
from femfit.integrate.uncertainty import white_sigma

_LEAST = 3
"""Samples of a settled plateau."""

_ROUNDING = 1e-9
"""Resolution of a clock, s."""


@dataclass(frozen=True)
class PlateauOptions:
    """How a run is cut and its offset voltage found, as :func:`~femfit.integrate.bench_table.make_bench_table` says.

    An error of R i on a plateau is taken off with the offset. Neither neighbouring samples of a
    plateau nor its first and last quarter may differ by more than ``still_A`` and ``still_m``.
    """

    settling: float = 0.0
    still_A: float = 1e-3
    still_m: float = 1e-6


@dataclass(frozen=True, eq=False)
class PlateauFlux:
    """Flux linkage on the p settled plateaus of a run, arrays of shape (p,)."""

    # Samples of each plateau, the last exclusive
    first: IntArray
    last: IntArray
    # Mean flux linkage minus that of the first plateau, Wb, and its standard uncertainty (type A): from the samples'
    # white noise and the offset's wander between plateaus
    flux: FloatArray
    sigma: FloatArray
    branch: FloatArray  # Sign of the last change of current: +1, -1, or 0 before any


def plateau_flux(
    time: FloatArray, voltage: FloatArray, current: FloatArray, distance: FloatArray, options: PlateauOptions
) -> PlateauFlux:
    """Integrate a run's induced voltage dlambda/dt plus offset, V, and average it on the plateaus.

    The voltage is u - R i of an excitation winding, u of a sensing coil; current in A and
    distance in m tell the plateaus.
    """
    if len(time) < _LEAST or np.any(np.diff(time) <= 0.0):
        raise TableError("A bench record's time_s must rise in each run; give each run its number in a column run.")
    first, last = _plateaus(time, current, distance, options)
    if len(first) < 2:
        raise TableError(
            f"A run needs at least 2 plateaus of {_LEAST} samples; {len(first)} found, with current still to "
            f"{options.still_A:g} A, distance to {options.still_m:g} m and {options.settling:g} s of settling. Raise "
            "the limits above the noise of these columns, or shorten the settling."
        )
    spans = list(zip(first, last, strict=True))
    means, level = (np.array([values[a:b].mean() for a, b in spans]) for values in (voltage, current))
    rest = voltage - np.interp(time, time[np.stack([first, last - 1], axis=1)].ravel(), np.repeat(means, 2))
    flux = cumulative_trapezoid(rest, time, initial=0)
    mean = np.array([flux[a:b].mean() for a, b in spans])
    sigma = np.sqrt(_variance(time, voltage, first, last))
    change = np.diff(level, prepend=level[0])
    turn = pd.Series(np.where(np.abs(change) > options.still_A, np.sign(change), np.nan))
    branch = np.asarray(turn.ffill().fillna(0.0), dtype=np.float64)
    return PlateauFlux(first, last, mean - mean[0], sigma, branch)


def _variance(time: FloatArray, voltage: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    """Variance of a plateau's mean integral minus the first's, Wb^2, by white noise and by the offset's wander; (p,).

    On a plateau the mean is taken off, which leaves a bridge whose mean has held / 12; between plateaus the walk and
    the two means' errors count, each mean in the gap before it and in the gap after it.

    How far the offset leaves the straight line between plateaus is seen where nothing changes: the middle of each
    plateau, as long as the time between two, against the means of the rest before and after it. What white noise does
    to that is taken off. Cautious: two gaps share a plateau's mean, and a part of their errors cancels.
    """
    noise, step, count = white_sigma(voltage), float(np.median(np.diff(time))), last - first
    held, gap = step * count, time[first[1:]] - time[last[:-1] - 1]
    before, after = np.concatenate([[0.0], gap]), np.concatenate([gap, [0.0]])
    inner = np.concatenate([[0.0], np.cumsum(np.square(before + after) / 4.0 / count)])[:-1]
    through = inner + np.square(before) / 4.0 / count
    white = step * (np.cumsum(before) + (held[0] + held) / 12.0) + through
    white[0] = 0.0  # against itself
    middle = max(1, round(float(np.median(gap)) / step))
    surplus = []
    for a, side in zip(first, (count - middle) // 2, strict=True):
        if side < 1:
            continue
        early, between, late = np.split(voltage[a : a + 2 * side + middle], [side, side + middle])
        strayed = step * (between.sum() - 0.5 * middle * (early.mean() + late.mean()))
        surplus.append(strayed**2 - (step * noise) ** 2 * (middle + 0.5 * middle**2 / side))
    wander = max(0.0, float(np.mean(surplus))) if surplus else 0.0
    return noise**2 * white + wander * np.cumsum(np.square(before / (step * middle)))


def _plateaus(
    time: FloatArray, current: FloatArray, distance: FloatArray, options: PlateauOptions
) -> tuple[IntArray, IntArray]:
    """Settled stretches in which neither current nor distance moves."""
    moved = (np.abs(np.diff(current)) > options.still_A) | (np.abs(np.diff(distance)) > options.still_m)
    cuts = np.concatenate([[0], np.flatnonzero(moved) + 1, [len(time)]])
    channels = ("current", current, options.still_A, "A"), ("distance", distance, options.still_m, "m")
    spans = []
    for a, b in itertools.pairwise(cuts.tolist()):
        # A sample beside a change may hold a part of it. The first plateau follows no change, the last precedes none.
        begin = a if a == 0 else max(a + 1, int(np.searchsorted(time, time[a] + options.settling - _ROUNDING)))
        end = b if b == len(time) else b - 1
        if end - begin < _LEAST:
            continue
        spans.append((begin, end))
        quarter = max(1, (end - begin) // 4)
        for name, values, still, unit in channels:
            crept = abs(float(values[end - quarter : end].mean() - values[begin : begin + quarter].mean()))
            if crept > still:
                raise TableError(
                    f"The {name} changes slowly from {time[begin]:g} to {time[end - 1]:g} s, by {crept:.3g} {unit} in "
                    f"all, although no two neighbouring samples differ by more than {still:g} {unit}. If this is a "
                    "ramp, give a limit below its step from sample to sample, or leave out samples; if it is a "
                    f"plateau, give a limit above the change. The limit is --still-{'A' if unit == 'A' else 'um'}."
                )
    pairs = np.array(spans, dtype=np.int64).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
