"""What may be wrong with a coil record, watched while it streams past the filter.

Each finding names the suspect. None stops the integration: a gap, for one, is bridged by the trapezoid and paid for in
variance.
"""

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd

from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.results import Finding, Words
from femfit.integrate.uncertainty import (
    AGREEMENT,
    CLIPPED_RUN,
    CLIPPED_STEPS,
    COMPARED_S,
    GAIN_TOLERANCE,
    GAP,
    INNOVATION_BAND,
    INNOVATIONS_AVERAGED,
    RANGE_SLACK,
    STEPS_COMPARED,
    STUCK_OFFSET_V,
    STUCK_SHARE,
    STUCK_TIME_S,
    FieldBlock,
)
from femfit.tables.coil_record import CoilBlock

finding = Words("femfit.integrate", names={}).finding
"""What is remarked on coil records; the words stand in ``templates/findings.j2``."""

Reference = Literal["hall_T", "current_A"]


_STRETCH = ("begin", "end", "samples", "reading", "low", "high")
"""Of a stretch: its first and last time in s, and between which values something else moved meanwhile."""


class EqualReadings:
    """Stretches of equal readings of one column, which streams past block by block."""

    def __init__(self) -> None:
        self._rows: list[FloatArray] = []  # Of stretches that may matter, the last block's open one at the end
        self._carried = np.empty((0, 4))  # Rows of time, reading, path and number of samples, for the open stretch
        self.step = np.inf  # The smallest difference of two readings in a row
        self._levels = pd.Series(dtype=np.float64)  # How often the smallest and the largest readings came, rising

    def see(self, time: FloatArray, readings: FloatArray, path: FloatArray) -> None:
        """Take in a block.

        Parameters
        ----------
        time, readings, path : array, shape (samples,)
            In s, what may repeat, and something else that moves meanwhile, NaN where it is not known.
        """
        present = np.isfinite(readings)
        if not present.any():
            return
        self._count(readings[present])
        samples = np.column_stack([time, readings, path, np.ones(len(time))])[present]
        times, values, others, counts = np.concatenate([self._carried, samples]).T
        starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
        ends = np.append(starts[1:], len(values)) - 1
        low, high = np.fmin.reduceat(others, starts), np.fmax.reduceat(others, starts)
        columns = [times[starts], times[ends], np.add.reduceat(counts, starts), values[starts], low, high]
        rows = np.column_stack(columns)
        begin, end, count, reading, least, most = rows[-1]
        self._carried = np.array([[begin, reading, least, count - 1.0], [end, reading, most, 1.0]])
        table = self._marked(rows)
        worth = (table["lasting"] | table["highest"]).to_numpy()
        self._rows = [*self._rows[:-1], rows[:-1][worth[:-1]], rows[-1:]]

    def stretches(self) -> pd.DataFrame:
        """The stretches that last longer than a living reading repeats, or stand at the largest |reading|."""
        return self._marked(np.concatenate([*self._rows, np.empty((0, len(_STRETCH)))]))

    def cut_off(self, stretches: pd.DataFrame) -> BoolArray:
        """Which stretches at the largest |reading| are a limit that the signal ran into.

        A converter's steps below the largest |reading| tell how fast the signal came near it, as the inverse of how
        often they were read. Its square falls evenly, or ever less, towards a maximum or a plateau, where the signal
        comes to rest; at a limit it would have been at rest only beyond the outermost step.
        """
        at_the_end = bool(self._levels.index[-1:] == self.highest)
        outermost = self._levels.to_numpy()[:: -1 if at_the_end else 1]
        near, far = (
            outermost[1 : 1 + STEPS_COMPARED].sum(),
            outermost[1 + STEPS_COMPARED : 1 + 2 * STEPS_COMPARED].sum(),
        )
        # The line through the two squares, STEPS_COMPARED steps apart, is still above 0 at the outermost step's end.
        beyond = STEPS_COMPARED * far**2 > (0.5 * STEPS_COMPARED + 1.0) * (near**2 - far**2)
        return np.asarray(stretches["highest"].to_numpy() & (len(outermost) >= CLIPPED_STEPS) & bool(beyond))

    def _marked(self, rows: FloatArray) -> pd.DataFrame:
        """Stretches with how long they last, how far something else moved, and whether that, or their place, tells."""
        table = pd.DataFrame(rows, columns=_STRETCH)
        duration, samples = table["end"] - table["begin"], table["samples"]
        return table.assign(
            duration=duration,
            motion=table["high"] - table["low"],
            lasting=(duration >= STUCK_TIME_S) & (samples > CLIPPED_RUN),
            highest=(table["reading"].abs() == self.highest) & (samples >= CLIPPED_RUN),
        )

    @property
    def highest(self) -> float:
        """The largest |reading|."""
        return float(np.abs(self._levels.index.to_numpy()).max(initial=0.0))

    def _count(self, readings: FloatArray) -> None:
        """Look for a block's smallest step and extremes."""
        change = np.abs(np.diff(readings))
        self.step = min(self.step, float(change[change > 0.0].min(initial=np.inf)))
        if len(self._levels) >= CLIPPED_STEPS:
            low, high = self._levels.index[[CLIPPED_STEPS - 1, -CLIPPED_STEPS]]
            readings = readings[(readings <= low) | (readings >= high)]
        levels, counts = np.unique(readings, return_counts=True)
        self._levels = self._levels.add(pd.Series(counts, levels, dtype=np.float64), fill_value=0.0).sort_index()
        if len(self._levels) > 2 * CLIPPED_STEPS:
            self._levels = self._levels.iloc[np.r_[:CLIPPED_STEPS, -CLIPPED_STEPS:0]]


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
    currents : (float, float) or None
        Between which a field model holds, A.
    """

    def __init__(
        self,
        area: float,
        sample_time: float,
        reference: Reference | None = None,
        scale: float | None = None,
        currents: tuple[float, float] | None = None,
    ) -> None:
        self.area, self.sample_time = area, sample_time
        self.reference, self.scale, self.currents = reference, scale, currents
        self._tallies: dict[str, Tally] = {}
        self._time = self._voltage = float("nan")
        self._equal = {name: EqualReadings() for name in ("voltage", "hall")}
        # What the coil saw the field move by since the record began, and between which values that went, T
        self._path, self._low, self._high = 0.0, 0.0, 0.0
        self._waiting = np.empty((2, 0))  # times and normalised squares of the latest innovations
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
        path = self._path + np.cumsum(rise)
        self._path = float(path[-1])
        self._low, self._high = min(self._low, float(path.min())), max(self._high, float(path.max()))
        comparable = self.reference == "hall_T" and self.scale is not None
        field = block.hall if comparable and block.hall is not None else np.full(len(block), np.nan)
        for name, equal in self._equal.items():
            if (readings := getattr(block, name)) is not None:
                equal.see(block.time, readings, field if name == "voltage" else path)
        reading = {"hall_T": block.hall, "current_A": block.current, None: None}[self.reference]
        if reading is not None:
            self._compare(rise, reading)

    def findings(self) -> tuple[Finding, ...]:
        """What was seen."""
        tallies = self._tallies | self._repeated()
        findings = [finding(code, **asdict(tallies[code])) for code in _TALLIED if code in tallies]
        if self._slope() < 0.0:
            findings.append(finding("sign", of_hall=self.reference == "hall_T"))
        slope = self._slope() * (self.scale or math.nan)  # the reference's changes over the coil's
        if abs(slope - 1.0) > GAIN_TOLERANCE and not {remark.code for remark in findings} & _NO_GAIN:
            numbers: dict[str, Any] = {"slope": slope, "area_m2": self.area / slope, "ratio_A_per_T": self._slope()}
            findings.append(finding("gain", size=slope - 1.0, of_hall=self.reference == "hall_T", **numbers))
        if "innovations" in tallies:
            codes = {remark.code for remark in findings}
            suspect = next((code for code in _SUSPECTS if code in codes), self.reference)
            findings.append(finding("innovations", suspect=suspect, **asdict(tallies["innovations"])))
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

    def _repeated(self) -> dict[str, Tally]:
        """What stretches of equal readings say of each column.

        A coil's voltage is contradicted by a Hall probe that saw the field move by another amount; where it looks cut
        off at its limit, by one that saw it move by less. A Hall probe may stand still where the field does: it is
        contradicted by a coil that saw the field move.
        """
        voltage, hall = (equal.stretches() for equal in self._equal.values())
        limit = self._equal["voltage"].cut_off(voltage)
        per_volt = np.nan_to_num(abs(self._slope()), nan=1.0) / self.area  # T/s of a Hall probe, whatever its gain
        more = per_volt * voltage["reading"].abs() * voltage["duration"] - voltage["motion"]
        # What a coil makes of an offset voltage meanwhile, and of half a step of its converter
        drift_V = STUCK_OFFSET_V + 0.5 * self._equal["voltage"].step
        slack = STUCK_SHARE * self._equal["hall"].highest + drift_V / self.area * voltage["duration"]
        cut_off = limit & ~(more > slack)
        dead = voltage["lasting"] & (more.abs() > slack)
        seen = STUCK_SHARE * (self._high - self._low) + STUCK_OFFSET_V / self.area * hall["duration"]
        still = hall["lasting"] & (hall["motion"] > seen)
        chosen = {
            "clipped": voltage[cut_off],
            "stuck": hall[still & ~hall["highest"]],
            "saturated": hall[still & hall["highest"]],
            "stuck-voltage": voltage[dead & ~cut_off],
        }
        tallies = {}
        for code, rows in chosen.items():
            if len(rows):
                lasted = float((rows["duration"] + self.sample_time).sum())
                tallies[code] = Tally(int(rows["samples"].sum()), float(rows["begin"].iloc[0]), lasted)
        return tallies

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

    def _slope(self) -> float:
        """The reference's changes over the coil's, in its unit per T; NaN where the two are not the same thing."""
        xx, xy, yy = self._products.tolist()
        return xy / xx if xy**2 > AGREEMENT * xx * yy else math.nan  # also where one of them saw no change at all


_TALLIED = ("gap", "clock", "clipped", "stuck", "saturated", "stuck-voltage", "range")
"""Codes of what is counted, in the order in which it is told."""

_NO_GAIN = {"sign", "stuck", "saturated", "clipped", "stuck-voltage"}
"""Codes of findings that make coil and reference differ as a wrong gain does."""

_SUSPECTS = ("sign", "stuck", "saturated", "stuck-voltage", "clipped", "gain", "gap", "clock", "range")
"""Codes of findings that may cause large innovations; the first that applies is suspected."""
