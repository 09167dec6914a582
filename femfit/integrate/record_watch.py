"""What may be wrong with a coil record, watched while it streams past the filter.

Each finding names the suspect. None stops the integration: a gap, for one, is bridged by the trapezoid and paid for in
variance.
"""

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd

from femfit.core.numerics import FloatArray
from femfit.core.results import Finding
from femfit.integrate.constants import (
    AGREEMENT,
    COMPARED_S,
    GAIN_TOLERANCE,
    GAP,
    INNOVATION_BAND,
    INNOVATIONS_AVERAGED,
    RANGE_SLACK,
    STUCK_OFFSET_V,
    STUCK_SHARE,
)
from femfit.integrate.equal_readings import EqualReadings
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
        self._equal = {name: EqualReadings() for name in ("voltage", "hall", "current")}
        # What the coil saw the field move by since the record began, and between which values that went, T
        self._path, self._low, self._high = 0.0, 0.0, 0.0
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
        findings += self._disagreement()
        if not {remark.code for remark in findings} & _NO_GAIN:
            findings += self._gain_of_changes() or self._gain_finding()
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

    def _repeated(self) -> dict[str, Tally]:
        """What stretches of equal readings say of each column.

        A coil's voltage is contradicted by its own noise, or by a Hall probe that saw the field move by another amount;
        where it looks cut off at its limit, by one that saw it move by less. A Hall probe may stand still where the
        field does, and a current besides at what its meter shows of none: they are contradicted by a coil that saw the
        field move. A field may creep behind a current; so the current's own noise must contradict it too.
        """
        tables = {name: equal.stretches() for name, equal in self._equal.items()}
        unlikely = {name: equal.unlikely(tables[name]) for name, equal in self._equal.items()}
        voltage, hall, current = tables.values()
        limit = self._equal["voltage"].cut_off(voltage)
        per_volt = np.nan_to_num(abs(self._slope()), nan=1.0) / self.area  # T/s of a Hall probe, whatever its gain
        more = per_volt * voltage["reading"].abs() * (voltage["end"] - voltage["begin"]) - _motion(voltage)
        step = float(self._equal["voltage"].step.min())
        slack = STUCK_SHARE * self._equal["hall"].highest + self._drift(voltage, step)
        once = _motion(voltage).isna() & (np.sum(limit) == 1) & unlikely["voltage"]
        cut_off = limit & ~(more > slack) & ~once
        dead = unlikely["voltage"] | (voltage["lasting"] & (more.abs() > slack))
        still = hall["lasting"] & self._moved(hall)
        frozen = unlikely["current"] & ~current["least"] & self._moved(current)
        chosen = {
            "clipped": voltage[cut_off],
            "stuck": hall[still & ~hall["highest"]],
            "saturated": hall[still & hall["highest"]],
            "stuck-voltage": voltage[dead & ~cut_off],
            "stuck-current": current[frozen],
        }
        tallies = {}
        for code, rows in chosen.items():
            if len(rows):
                lasted = float((rows["end"] - rows["begin"] + self.sample_time).sum())
                tallies[code] = Tally(int(rows["samples"].sum()), float(rows["begin"].iloc[0]), lasted)
        return tallies

    def _moved(self, stretches: pd.DataFrame) -> "pd.Series[bool]":
        """During which stretches the coil saw the field move, by more than an offset voltage makes of their time."""
        return _motion(stretches) > STUCK_SHARE * (self._high - self._low) + self._drift(stretches)

    def _drift(self, stretches: pd.DataFrame, step: float = 0.0) -> "pd.Series[float]":
        """What a coil makes of an offset voltage and of half a step of its converter meanwhile, T."""
        return (STUCK_OFFSET_V + 0.5 * step) / self.area * (stretches["end"] - stretches["begin"])

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

    def _disagreement(self) -> list[Finding]:
        """Whether coil and reference see the field move in opposite directions."""
        return [finding("sign", of_hall=self.reference == "hall_T")] if self._slope() < 0.0 else []

    def _gain_of_changes(self) -> list[Finding]:
        """Whether coil and reference see the field move by different amounts."""
        slope = self._slope() * (self.scale or math.nan)
        if not abs(slope - 1.0) > GAIN_TOLERANCE:
            return []
        numbers: dict[str, Any] = {"slope": slope, "area_m2": self.area / slope, "ratio_A_per_T": self._slope()}
        of_hall = self.reference == "hall_T"
        return [finding("gain", words="gain_of_changes", size=slope - 1.0, of_hall=of_hall, **numbers)]

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


_TALLIED = ("gap", "clock", "clipped", "stuck", "saturated", "stuck-voltage", "stuck-current", "range")
"""Codes of what is counted, in the order in which it is told."""

_NO_GAIN = {"sign", "stuck", "saturated", "clipped", "stuck-voltage", "stuck-current"}
"""Codes of findings that make coil and reference differ as a wrong gain does."""

_SUSPECTS = (
    *("sign", "stuck", "saturated", "stuck-voltage", "clipped", "stuck-current", "gain", "gap", "clock", "range"),
)
"""Codes of findings that may cause large innovations; the first that applies is suspected."""


def _motion(stretches: pd.DataFrame) -> "pd.Series[float]":
    """How far something else moved during each stretch; NaN where that is not known."""
    return stretches["high"] - stretches["low"]
