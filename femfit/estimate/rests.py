"""Where a body in a record stands still, and whether something holds it there.

A body stands still where the means of short blocks of its distance agree within the sensor's noise. It is free
there if the forces balance, as in a hover, and held if they do not: then a free body would have an acceleration
(static force - F) / m that the record does not show. The model's force may be wrong, that is what a record is taken
for; so the body counts as held only where F / 2 and 2 F miss the balance on the same side by five times the noise of
the acceleration, or where it lies on a stop of the drawing. With the test function phi = (1 - s^2)^2 over a window of n
samples and the length T, the noise of the mean acceleration is that of the sum of phi'' over the samples.

References
----------
M. Shinbrot, Transactions of the ASME 79 (1957) 579: method of modulating functions.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.core.text import amount, amount_range, counted
from femfit.estimate.constants import AT_STOP, BLOCK, DECISIVE, STILL
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.findings import finding

LEAST_BLOCKS = 4
"""Conventional: blocks of a rest; fewer are a turning point."""

WRONG_FACTOR = 2.0
"""Conventional: a model is taken to be wrong by less than this factor in its force. A body that stands still where no
such error balances the forces is held; one that could be balanced is taken as free."""

FINEST = 1e-7
"""Numerical: part of the validity domain below which a simulated distance is rounding, not noise."""


@dataclass(frozen=True)
class Rest:
    """A stretch in which the body stands still and is not free: rows ``first`` to ``last``, both included."""

    first: int
    last: int
    distance_m: float
    place: str  # On a stop of the drawing, "near" or "far", or "held" by what the model does not know


@dataclass(frozen=True, eq=False)
class Rests:
    """All rests of a record, and the samples at which more than the model's forces acts on the body."""

    rests: tuple[Rest, ...]
    contact: BoolArray  # At rest, or touching where it rests; (samples,)
    findings: tuple[Finding, ...]

    @property
    def held(self) -> BoolArray:
        """Samples of the rests, shape (samples,)."""
        result = np.zeros(len(self.contact), dtype=bool)
        for rest in self.rests:
            result[rest.first : rest.last + 1] = True
        return result


@dataclass(frozen=True, eq=False)
class Track:
    """Where a body was in a record, and with which currents; arrays of N samples, NaN where missing."""

    time_s: FloatArray
    segment: IntArray  # Number of the stretch without a gap of the clock
    distance_m: FloatArray
    current_A: FloatArray  # Of all circuits, (N, n)
    noise_m: float  # Standard deviation of one sample of the distance; NaN where unknown
    noise_A: Sequence[float] = ()  # And of each current


def find_rests(model: ActuatorModel, track: Track) -> Rests:
    """Find the rests of a record whose distance is recorded."""
    distance, segment = track.distance_m, track.segment
    contact = np.zeros(len(distance), dtype=bool)
    if model.motion is None or not track.noise_m >= 0.0:
        return Rests((), contact, ())
    travel = model.validity.distance_max_m - model.validity.distance_min_m
    noise_m, places = max(track.noise_m, FINEST * travel), ("near", "far")
    rests: list[Rest] = []
    for first, last, level in _still_stretches(segment, distance, noise_m):
        rows, misses = slice(first, last + 1), np.abs(level - np.array(model.motion.ends))
        close = max(STILL * noise_m, AT_STOP * travel)
        on_stop = [name for name, miss in zip(places, misses, strict=True) if miss <= close]
        if not on_stop and not _unbalanced(model, track, rows, noise_m):
            continue
        away = np.abs(np.nan_to_num(distance[rows] - level))
        arrives = first > 0 and segment[first - 1] == segment[first]
        leaves = last + 1 < len(segment) and segment[last + 1] == segment[last]
        early = first + (_moving(away, noise_m) if arrives else 0)
        late = last - (_moving(away[::-1], noise_m) if leaves else 0)
        if late - early >= BLOCK:
            rests.append(Rest(early, late, level, on_stop[0] if on_stop else "held"))
        contact[rows] = True
    contact |= _touching(model, distance, rests, noise_m)
    return Rests(tuple(rests), contact, tuple(_remarks(track, rests)))


def _still_stretches(segment: IntArray, distance: FloatArray, noise: float) -> list[tuple[int, int, float]]:
    """First and last row, and mean, of every stretch of a channel whose blocks agree."""
    stretches = []
    edges = np.flatnonzero(np.diff(segment, prepend=segment[:1] - 1, append=segment[-1:] + 1))
    for begin, end in pairwise(edges.tolist()):
        count = (end - begin) // BLOCK
        blocks = pd.DataFrame(distance[begin : begin + count * BLOCK].reshape(count, BLOCK))
        means = blocks.mean(axis=1).to_numpy()  # of the readings that there are
        start = 0
        while start < count:
            stop, low, high = start, means[start], means[start]
            while stop < count and max(high, means[stop]) - min(low, means[stop]) <= STILL * noise:
                low, high = min(low, means[stop]), max(high, means[stop])
                stop += 1
            if stop - start >= LEAST_BLOCKS:
                last = end if stop == count else begin + stop * BLOCK
                stretches.append((begin + start * BLOCK, last - 1, float(means[start:stop].mean())))
            start = max(stop, start + 1)
    return stretches


def _moving(away: FloatArray, noise: float) -> int:
    """Samples at the begin of a stretch in which the body is on its way: its mean is off, and one block before that."""
    means = np.convolve(away, np.full(BLOCK, 1.0 / BLOCK), mode="valid")
    # The mean magnitude of noise alone is 0.8 of its deviation, and of a block's mean 0.6 / sqrt(8) uncertain
    there = np.flatnonzero(means <= noise)
    return BLOCK + int(there[0] if len(there) else len(away))


def _unbalanced(model: ActuatorModel, track: Track, rows: slice, noise: float) -> bool:
    """Whether no force within a factor of two of the model's would leave the body where it stands."""
    time, distance, current = track.time_s[rows], track.distance_m[rows], track.current_A[rows]
    finite = np.isfinite(distance) & np.isfinite(current).all(axis=1)
    if finite.sum() < LEAST_BLOCKS * BLOCK:
        return False
    time, distance, current = time[finite], distance[finite], current[finite]
    motion, box = model.require_motion(), model.validity
    # A reading that noise carries out of the domain is the domain's end
    d = np.clip(np.full(len(distance), distance.mean()), box.distance_min_m, box.distance_max_m)
    i = np.clip(current, *box.current_limits_A[: current.shape[1]].T)
    pull, against = model.magnetics.force(d, i), motion.static_force(d)
    least = against - np.maximum(WRONG_FACTOR * pull, pull / WRONG_FACTOR) - motion.coulomb_N
    most = against - np.minimum(WRONG_FACTOR * pull, pull / WRONG_FACTOR) + motion.coulomb_N
    size = 2 * BLOCK
    while size <= len(time):
        cut, length = (len(time) // size, size), np.median(np.diff(time)) * size
        s = (2.0 * np.arange(size) + 1.0) / size - 1.0
        bump = (1.0 - s**2) ** 2
        mean = bump / bump.sum()
        curved = 12.0 * (s**2 - np.mean(s**2))  # an even function's best line is its mean
        curved /= 0.5 * (curved @ s**2) * (0.5 * length) ** 2  # exactly 1 for t^2 / 2
        distances, least_cut, most_cut = (values[: cut[0] * size].reshape(cut) for values in (distance, least, most))
        spread = max(noise * float(np.sqrt(curved @ curved)), float(np.median(np.abs(distances @ curved))))
        low, high = least_cut @ mean / motion.mass_kg, most_cut @ mean / motion.mass_kg
        if np.any((low > DECISIVE * spread) | (high < -DECISIVE * spread)):
            return True
        size *= 2
    return False


def _touching(model: ActuatorModel, distance: FloatArray, rests: list[Rest], noise: float) -> BoolArray:
    """Samples from which the body may have touched a stop before the next one, and their neighbours.

    An end of the path at which the body was held counts as a stop. A rebound lasts less than a sample; a stop gives way
    under an impact, so that samples a little beyond it touch it too.
    """
    box, stops = model.validity, np.array(model.require_motion().ends)
    means = np.convolve(distance, np.full(BLOCK, 1.0 / BLOCK))[BLOCK - 1 : len(distance)]
    low = np.min(means, initial=np.inf, where=np.isfinite(means)) + STILL * noise
    high = np.max(means, initial=-np.inf, where=np.isfinite(means)) - STILL * noise
    held = [rest.distance_m for rest in rests if np.isfinite(low) and not low < rest.distance_m < high]
    ends = np.array([*stops[np.isfinite(stops)], *held])
    moved = np.abs(np.diff(distance))
    reach = np.fmax(np.r_[moved, 0.0], np.r_[0.0, moved]) + STILL * noise
    near = (np.abs(distance - ends[:, None]) <= reach).any(axis=0)
    depth = np.array([[1.0], [-1.0]]) * (stops[:, None] - distance)
    near |= ((depth >= 0.0) & (depth <= AT_STOP * (box.distance_max_m - box.distance_min_m))).any(axis=0)
    return np.asarray(np.convolve(near, np.ones(BLOCK + 1))[BLOCK // 2 :][: len(near)] > 0.5)


def _remarks(track: Track, rests: list[Rest]) -> Iterator[Finding]:
    """Where the body rests, at each kind of place."""
    for place in ("near", "far", "held"):
        at_place = [rest for rest in rests if rest.place == place]
        if not at_place:
            continue
        share = sum(rest.last - rest.first + 1 for rest in at_place) / len(track.time_s)
        where = amount_range(min(r.distance_m for r in at_place), max(r.distance_m for r in at_place), "m", 3)
        if len(at_place) == 1 or place != "held":
            where = amount(at_place[0].distance_m, "m", 3)
        yield finding(
            "held" if place == "held" else "at-stop",
            place=place,
            where=where,
            stretches=f"in {counted(len(at_place), 'stretch', 'stretches')}, {amount(share, '')} of the samples",
            span=amount_range(float(track.time_s[at_place[0].first]), float(track.time_s[at_place[0].last]), "s", 3),
            factor=WRONG_FACTOR,
            size=share,
        )
