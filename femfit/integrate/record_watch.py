"""What may be wrong with a coil record, watched while it streams past the filter.

Each finding names the suspect. None stops the integration: a gap, for one, is bridged by the trapezoid and paid for in
variance.
"""

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.integrate.constants import (
    AGREEMENT,
    CLIPPED_RUN,
    CLIPPED_STEPS,
    COMPARED_S,
    GAIN_TOLERANCE,
    GAP,
    INNOVATION_BAND,
    INNOVATIONS_AVERAGED,
    RANGE_SLACK,
    STUCK_SHARE,
    STUCK_TIME_S,
)
from femfit.integrate.identified_field import GainTest
from femfit.integrate.uncertainty import FieldBlock
from femfit.integrate.words import finding
from femfit.tables.coil_record import CoilBlock

Reference = Literal["hall_T", "current_A"]


@dataclass
class Tally:
    """How often something was seen, when first, and how much of it in all."""

    count: int = 0
    first: float = float("nan")
    amount: float = 0.0


@dataclass
class Repeats:
    """Runs of one and the same reading, across the blocks of a record, and how far something else moved meanwhile."""

    reading: float = float("nan")  # The last one
    run: int = 0  # How often it came in a row
    moved: float = 0.0

    def see(self, readings: FloatArray, change: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Begins, lengths and motions of the block's runs; the first may go on from the block before.

        Parameters
        ----------
        readings, change : array, shape (samples,)
            What repeats, and by how much the other quantity moved up to each sample.
        """
        new = np.flatnonzero(readings != np.concatenate([[self.reading], readings[:-1]]))
        goes_on = len(new) == 0 or new[0] > 0
        begins = np.concatenate([[0], new]) if goes_on else new
        ends = np.concatenate([begins[1:], [len(readings)]])
        path = np.concatenate([[0.0], np.cumsum(change)])
        lengths, moved = ends - begins, path[ends] - path[begins]
        if goes_on:
            lengths[0] += self.run
            moved[0] += self.moved
        self.reading, self.run, self.moved = float(readings[-1]), int(lengths[-1]), float(moved[-1])
        return begins, lengths, moved

    def forget(self) -> None:
        """Begin a run that was counted anew."""
        self.run, self.moved = 0, 0.0


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
    currents : (float, float) or None
        Between which a field model holds, A.
    gain_sigma : float
        What was declared of the ratio of the reference's gain to the coil's, relative.
    """

    def __init__(
        self,
        area: float,
        sample_time: float,
        reference: Reference | None = None,
        scale: float | None = None,
        currents: tuple[float, float] | None = None,
        gain_sigma: float = 0.0,
    ) -> None:
        self.area, self.sample_time = area, sample_time
        self.reference, self.scale, self.currents = reference, scale, currents
        self.gain_sigma, self._gain = gain_sigma, GainTest()
        self._tallies: dict[str, Tally] = {}
        self._time = self._voltage = float("nan")
        self._probe, self._coil = Repeats(), Repeats()
        self._steps = 0  # Different voltages in the block that has most
        self._field = float("nan")  # The reference's last field in T
        # The probe's largest |reading|, and the largest at which it stood still; the reference's largest field in T
        self._highest, self._stuck_at, self._largest = 0.0, 0.0, 0.0
        self._waiting = np.empty((4, 0))  # times, normalised squares and what GainTest sums of the latest innovations
        self._products = np.zeros(3)  # sums of xx, xy, yy of the changes that coil (x, T) and reference (y) saw

    def see(self, block: CoilBlock, out: FieldBlock | None = None) -> None:
        """Watch a block, and the field block that a filter made of it."""
        first = np.isnan(self._time)
        dt = np.diff(block.time, prepend=block.time[0] if first else self._time)
        before = np.concatenate([[block.voltage[0] if first else self._voltage], block.voltage[:-1]])
        rise = dt * (block.voltage + before) / (2.0 * self.area)
        gap, late = dt > GAP * self.sample_time, (dt < 0.5 * self.sample_time) & (dt > 0.0)
        self._add("gap", block.time[gap], float(np.sum(dt[gap])) - self.sample_time * int(np.sum(gap)))
        self._add("clock", block.time[late])
        if block.current is not None and self.currents is not None:
            low, high = self.currents
            slack = RANGE_SLACK * (high - low)
            self._add("range", block.time[(block.current < low - slack) | (block.current > high + slack)])
        self._time, self._voltage = float(block.time[-1]), float(block.voltage[-1])
        if out is not None:
            self._watch_innovations(out)
        if block.hall is not None:
            self._watch_probe(block.time, block.hall, rise)
        reading = {"hall_T": block.hall, "current_A": block.current, None: None}[self.reference]
        clipped = _clipped(block.voltage)
        if reading is not None:
            clipped &= ~self._watch_voltage(block, clipped, rise, reading)
            self._compare(rise, reading)
        self._add("clipped", block.time[clipped])

    def findings(self) -> tuple[Finding, ...]:
        """What was seen."""
        findings = []
        stuck = "saturated" if self._stuck_at >= (1.0 - 1e-9) * self._highest else "stuck"
        for source in _TALLIED:
            if source in self._tallies:
                code = stuck if source == "stuck" else source
                findings.append(finding(code, **asdict(self._tallies[source])))
        findings += self._disagreement()
        if not {remark.code for remark in findings} & _NO_GAIN:
            findings += self._gain_of_changes() or self._gain_finding()
        if "innovations" in self._tallies:
            codes = {remark.code for remark in findings}
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
        innovation, variance, of_gain = out.innovation[used], out.innovation_variance[used], out.innovation_gain[used]
        latest = [out.time[used], innovation**2 / variance, innovation * of_gain / variance, of_gain**2 / variance]
        innovations = np.concatenate([self._waiting, latest], axis=1)
        complete = innovations.shape[1] // INNOVATIONS_AVERAGED * INNOVATIONS_AVERAGED
        times, sums = (
            innovations[0, :complete:INNOVATIONS_AVERAGED],
            innovations[1:, :complete].reshape(3, -1, INNOVATIONS_AVERAGED).sum(2),
        )
        means = sums[0] / INNOVATIONS_AVERAGED
        self._gain.see(sums[0] - INNOVATIONS_AVERAGED, sums[1:])
        outside = means > INNOVATION_BAND
        self._add("innovations", times[outside])
        if outside.any():
            tally = self._tallies["innovations"]
            tally.amount = max(tally.amount, float(means.max()))
        self._waiting = innovations[:, complete:]

    def _watch_probe(self, time: FloatArray, hall: FloatArray, rise: FloatArray) -> None:
        """Runs of one and the same reading while the coil sees the field move."""
        finite = np.isfinite(hall)
        if not finite.any():
            return
        self._highest = max(self._highest, float(np.abs(hall[finite]).max()))
        begins, lengths, moved = self._probe.see(hall, rise)
        stuck = self._lasting(lengths) & (np.abs(moved) > STUCK_SHARE * self._highest)
        self._add("stuck", time[begins[stuck]], float(np.sum(lengths[stuck])) * self.sample_time)
        self._stuck_at = max(self._stuck_at, float(np.abs(hall[begins[stuck]]).max(initial=0.0)))
        if stuck[-1]:
            self._probe.forget()

    def _watch_voltage(self, block: CoilBlock, clipped: BoolArray, rise: FloatArray, reading: FloatArray) -> BoolArray:
        """Runs of one and the same voltage while the reference sees the field move otherwise than it says, as a mask.

        Where the converter seems to clip, only those that say more than the field moves: a cut voltage says less.
        """
        none = np.zeros(len(block), dtype=np.bool_)
        if self.scale is None:
            return none
        field = pd.Series(np.concatenate([[self._field], self.scale * reading])).ffill().to_numpy()
        change = np.nan_to_num(np.diff(field))
        self._field = float(field[-1])
        self._largest = max(self._largest, float(np.nanmax(np.abs(field), initial=0.0)))
        self._steps = max(self._steps, len(np.unique(block.voltage)))
        begins, lengths, apart = self._coil.see(block.voltage, change - rise)
        stuck = self._lasting(lengths) & (np.abs(apart) > STUCK_SHARE * self._largest)
        stuck &= ~clipped[begins] | (apart * block.voltage[begins] < 0.0)
        if self._steps < CLIPPED_STEPS or not stuck.any():
            return none
        self._add("stuck-voltage", block.time[begins[stuck]], float(np.sum(lengths[stuck])) * self.sample_time)
        if stuck[-1]:
            self._coil.forget()
        ends = np.append(begins[1:], len(block))
        return np.repeat(stuck, ends - begins)

    def _lasting(self, lengths: IntArray) -> BoolArray:
        """Which runs are longer than a living reading repeats."""
        return (lengths * self.sample_time >= STUCK_TIME_S) & (lengths > CLIPPED_RUN)

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

    def _disagreement(self) -> list[Finding]:
        """Whether coil and reference see the field move in opposite directions."""
        xx, xy, yy = self._products.tolist()
        opposite = xy < 0.0 and xy**2 > AGREEMENT * xx * yy
        return [finding("sign", of_hall=self.reference == "hall_T")] if opposite else []

    def _gain_of_changes(self) -> list[Finding]:
        """Whether coil and reference see the field move by different amounts."""
        xx, xy, yy = self._products.tolist()
        if xy**2 <= AGREEMENT * xx * yy:  # also where one of them saw no change at all
            return []
        of_hall = self.reference == "hall_T"
        slope = xy / xx * (self.scale or 0.0)
        if self.scale is None or abs(slope - 1.0) <= GAIN_TOLERANCE:
            return []
        numbers: dict[str, Any] = {
            "of_hall": of_hall,
            "slope": slope,
            "area_m2": self.area / slope,
            "ratio_A_per_T": xy / xx,
        }
        return [finding("gain", words="gain_of_changes", size=slope - 1.0, **numbers)]

    def _gain_finding(self) -> list[Finding]:
        """Whether the innovations show that coil and Hall probe differ by a gain."""
        result = self._gain.result()
        if result is None or self.reference != "hall_T":
            return []
        ratio, sigma = result
        expanded = 200.0 * sigma
        numbers: dict[str, Any] = {
            "ratio": ratio,
            "expanded_percent": expanded,
            "digits": max(0, -math.floor(math.log10(expanded))),
            "area_m2": self.area / ratio,
            "declared": abs(ratio - 1.0) <= 2.0 * (self.gain_sigma + sigma),
        }
        return [finding("gain", size=ratio - 1.0, **numbers)]


_TALLIED = ("gap", "clock", "clipped", "stuck", "stuck-voltage", "range")
"""Codes of what is counted, in the order in which it is told."""

_NO_GAIN = {"sign", "stuck", "saturated", "clipped", "stuck-voltage"}
"""Codes of findings that make coil and reference differ as a wrong gain does."""

_SUSPECTS = ("sign", "stuck", "saturated", "stuck-voltage", "clipped", "gain", "gap", "clock", "range")
"""Codes of findings that may cause large innovations; the first that applies is suspected."""


def _clipped(voltage: FloatArray) -> BoolArray:
    """Samples in runs of equal values at the largest |voltage| of the block, as a mask."""
    highest = float(np.abs(voltage).max())
    at_top = np.abs(voltage) == highest
    clipped = np.zeros(len(voltage), dtype=np.bool_)
    if highest == 0.0 or int(at_top.sum()) < CLIPPED_RUN:
        return clipped
    edges = np.flatnonzero(np.diff(at_top, prepend=False, append=False))
    begins, ends = edges[::2], edges[1::2]
    long = ends - begins >= CLIPPED_RUN
    if not long.any() or len(np.unique(voltage)) < CLIPPED_STEPS:
        return clipped
    for begin, end in zip(begins[long], ends[long], strict=True):
        clipped[begin:end] = True
    return clipped
