"""What may be wrong with a coil record, watched while it streams past the filter.

Each finding names the suspect. None stops the integration: a gap, for one, is bridged by the trapezoid and paid for in
variance.
"""

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.results import Finding, Words, listing
from femfit.integrate.integrator import GAP, LastSample, increments
from femfit.integrate.uncertainty import FieldBlock, LinearSigma, Noise, SensingCoil, white_sigma
from femfit.tables.coil_record import CoilBlock

_WORDS = Words("femfit.integrate", listing, names={})
finding, sentence = _WORDS.finding, _WORDS.sentence
"""What is remarked on coil records, and printed of results; the words stand in ``templates``."""

Reference = Literal["hall_T", "current_A"]

NOISELESS = Noise(LinearSigma(0.0), LinearSigma(0.0), 0.0)

CLIPPED_RUN = 4
"""So many equal samples in a row at the largest |voltage| are clipped where noise above a converter's steps, or a rise
of two samples before, leads beyond it. Chosen: two neighbours are equal by chance, four at the very top hardly ever."""

CLIPPED_LEVELS = 16
"""A record of fewer different voltages is quiet, or computed. Chosen."""

STUCK_TIME_S = 0.05
"""For so long a living instrument never repeats a reading exactly. Chosen: its noise is above its resolution."""

STUCK_SHARE = 0.01
"""A reading is stuck if coil and probe meanwhile saw the field move differently by this share of all that they saw in
the record. Chosen: far above a probe's noise, far below a ramp."""

STUCK_OFFSET_V = 60e-6
"""What a coil makes of so much is no motion of the field. Derived: three standard deviations of an offset voltage that
nothing took off, an amplifier's own."""

GAIN_TOLERANCE = 0.05
"""Relative disagreement of coil and reference over the ramps that is put down to a wrong area or gain. Chosen: areas
are known to a per cent, wrong turns or wrong units are off by more."""

AGREEMENT = 0.8
"""Squared correlation from which the changes that coil and reference see are the same thing. Chosen."""

COMPARED_S = 0.1
"""Time over which changes of coil and reference are compared: long enough that white noise is small beside a ramp.
Chosen."""

INNOVATIONS_AVERAGED, INNOVATION_BAND = 50, 9.0
"""Mean square of 50 normalised innovations (1 in a true filter) beyond which they have left their band. Derived: its
standard deviation is sqrt(2 / 50) = 0.2, so this is 40 of them; a reference that is wrong by 3 sigma reaches it."""


class StillReadings:
    """Stretches of equal readings of a column, and how far something else moved meanwhile, block by block."""

    def __init__(self) -> None:
        self._open = np.empty((0, 3))  # Samples that tell the first and last time and the motion of the open stretch
        # First time, duration and motion of lasting stretches, the last block's open one at the end
        self.rows = [np.empty((0, 3))]

    def see(self, time: FloatArray, readings: FloatArray, path: FloatArray) -> None:
        """Take in a block: time in s, what may repeat, and something else that moves, each of shape (samples,)."""
        samples = np.column_stack([time, readings, path])[np.isfinite(readings)]
        samples = np.concatenate([self._open, samples])
        if not len(samples):
            return
        starts = np.flatnonzero(np.diff(samples[:, 1], prepend=np.nan) != 0.0)
        still = samples[starts[-1] :]
        extremes = [0, 1, 2, 3, 4, int(still[:, 2].argmin()), int(still[:, 2].argmax()), len(still) - 1]
        self._open = still[np.unique(np.minimum(extremes, len(still) - 1))]
        ends = np.append(starts[1:], len(samples)) - 1
        begin, duration = samples[starts, 0], samples[ends, 0] - samples[starts, 0]
        motion = np.maximum.reduceat(samples[:, 2], starts) - np.minimum.reduceat(samples[:, 2], starts)
        rows = np.column_stack([begin, duration, motion])
        lasting = (duration >= STUCK_TIME_S) & (ends - starts >= CLIPPED_RUN)
        self.rows = [*self.rows[:-1], rows[:-1][lasting[:-1]], rows[-1:][lasting[-1:]]]


@dataclass
class Tally:
    """How often something was seen, when first, and how much of it in all."""

    count: int = 0
    first: float = float("nan")
    amount: float = 0.0


class RecordWatch:
    """Watches a record, block by block.

    Parameters
    ----------
    area, sample_time : float
        Of the coil in m2, and of the record in s.
    reference : str or None
        The column that the coil is compared with.
    scale : float or None
        Field in T of one unit of the reference, where it is to be checked: 1 for a Hall probe beside a coil of known
        area, 1/g for a current with the ratio g. None compares the signs alone.
    """

    def __init__(
        self, area: float, sample_time: float, reference: Reference | None = None, scale: float | None = None
    ) -> None:
        self.coil, self.sample_time = SensingCoil(area), sample_time
        self.reference, self.scale = reference, scale
        self._tallies: dict[str, Tally] = {}
        self._last, self._still = LastSample(), StillReadings()
        # What the coil saw the field move by since the record began, and between which values that went, T
        self._path, self._low, self._high = 0.0, 0.0, 0.0
        self._waiting = np.empty((2, 0))  # times and normalised squares of the latest innovations
        self._products = np.zeros(3)  # sums of xx, xy, yy of the changes that coil (x, T) and reference (y) saw

    def see(self, block: CoilBlock, out: FieldBlock | None = None) -> None:
        """Watch a block, and the field block that a filter made of it."""
        last, (dt, rise, _) = increments(self._last, block, self.coil, NOISELESS, self.sample_time)
        gap, late = dt > GAP * self.sample_time, (dt < 0.5 * self.sample_time) & (dt > 0.0)
        self._add("gap", block.time[gap], float(np.sum(dt[gap])) - self.sample_time * int(np.sum(gap)))
        self._add("clock", block.time[late])
        if out is not None:
            self._watch_innovations(out)
        path = self._path + np.cumsum(rise)
        self._path = float(path[-1])
        self._low, self._high = min(self._low, float(path.min())), max(self._high, float(path.max()))
        self._watch_limit(block)
        self._last = last
        if block.hall is not None:
            self._still.see(block.time, block.hall, path)
        reading = {"hall_T": block.hall, "current_A": block.current, None: None}[self.reference]
        if reading is not None:
            self._compare(rise, reading)

    def findings(self) -> tuple[Finding, ...]:
        """What was seen."""
        counted: tuple[str, ...] = ("gap", "clock", "clipped")
        tallies = {code: self._tallies[code] for code in counted if code in self._tallies}
        # A Hall probe may stand still where the field does; a coil that saw the field move contradicts it
        rows = np.concatenate(self._still.rows)
        least = STUCK_SHARE * (self._high - self._low) + STUCK_OFFSET_V / self.coil.area_m2 * rows[:, 1]
        rows = rows[rows[:, 2] > least]
        if len(rows):
            tallies["stuck"] = Tally(len(rows), float(rows[0, 0]), float((rows[:, 1] + self.sample_time).sum()))
        findings = [finding(code, **asdict(tally)) for code, tally in tallies.items()]
        xx, xy, yy = self._products.tolist()
        # The reference's changes over the coil's; NaN where the two are not the same thing, or one saw no change at all
        slope = xy / xx if xy**2 > AGREEMENT * xx * yy else math.nan
        of_hall = self.reference == "hall_T"
        if slope < 0.0:
            findings.append(finding("sign", of_hall=of_hall))
        times = slope * (self.scale or math.nan)
        codes = {remark.code for remark in findings}
        if abs(times - 1.0) > GAIN_TOLERANCE and not codes & _NO_GAIN:
            area = self.coil.area_m2 / times
            facts: dict[str, Any] = {"of_hall": of_hall, "slope": times, "area_m2": area, "ratio_A_per_T": slope}
            findings.append(finding("gain", "", times - 1.0, **facts))
            codes.add("gain")
        if "innovations" in self._tallies:
            suspect = next((code for code in _SUSPECTS if code in codes), self.reference)
            findings.append(finding("innovations", suspect=suspect, **asdict(self._tallies["innovations"])))
        return tuple(findings)

    def _add(self, code: str, times: FloatArray, amount: float = 0.0) -> None:
        if len(times):
            tally = self._tallies.setdefault(code, Tally(first=float(times[0])))
            tally.count += len(times)
            tally.amount += amount

    def _watch_innovations(self, out: FieldBlock) -> None:
        """Hold means of normalised squares against the band; what is left over waits for more."""
        used = np.isfinite(out.innovation)
        latest = [out.time[used], out.innovation[used] ** 2 / out.innovation_variance[used]]
        innovations = np.concatenate([self._waiting, latest], axis=1)
        complete = innovations.shape[1] // INNOVATIONS_AVERAGED * INNOVATIONS_AVERAGED
        times = innovations[0, :complete:INNOVATIONS_AVERAGED]
        means = innovations[1, :complete].reshape(-1, INNOVATIONS_AVERAGED).mean(axis=1)
        outside = means > INNOVATION_BAND
        self._add("innovations", times[outside])
        if outside.any():
            tally = self._tallies["innovations"]
            tally.amount = max(tally.amount, float(means.max()))
        self._waiting = innovations[:, complete:]

    def _watch_limit(self, block: CoilBlock) -> None:
        """Runs of readings at the largest |voltage| so far that noise, or a change, leads beyond it."""
        size, before = np.abs(block.voltage), self._last.highest
        levels = np.unique(size)
        if levels[-1] > before:
            self._tallies.pop("clipped", None)
        if len(levels) < CLIPPED_LEVELS or levels[-1] < before:
            return
        noisy = white_sigma(block.voltage) > levels[-1] - levels[-2]
        edges = np.flatnonzero(np.diff(size == levels[-1], prepend=False, append=False)).reshape(-1, 2)
        for begin, end in edges[np.ptp(edges, axis=1) >= CLIPPED_RUN]:
            if noisy or (begin > 1 and size[begin - 2] < size[begin - 1]):
                self._add("clipped", block.time[begin:end])

    def _compare(self, rise: FloatArray, reading: FloatArray) -> None:
        """Sum up what coil and reference saw of the same changes."""
        size = max(1, round(COMPARED_S / self.sample_time))
        stretches = (len(rise) - 1) // size
        if stretches < 1:
            return
        x = rise[1 : 1 + stretches * size].reshape(stretches, size).sum(axis=1)
        y = np.diff(reading[: 1 + stretches * size : size])
        used = np.isfinite(y)
        x, y = x[used], y[used]
        self._products += x @ x, x @ y, y @ y


_NO_GAIN = {"sign", "stuck", "clipped"}
"""Codes of findings that make coil and reference differ as a wrong gain does."""

_SUSPECTS = ("sign", "stuck", "clipped", "gain", "gap", "clock")
"""Codes of findings that may cause large innovations; the first that applies is suspected."""
