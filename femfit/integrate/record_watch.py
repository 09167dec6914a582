"""What may be wrong with a coil record, watched while it streams past the filter.

Each finding names the suspect. None stops the integration: a gap, for one, is bridged by the trapezoid and paid for in
variance.
"""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.finding import Finding
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
from femfit.integrate.uncertainty import FieldBlock
from femfit.tables.coil_block import CoilBlock

Reference = Literal["hall_T", "current_A"]


@dataclass(frozen=True)
class Tally:
    """How often something was seen, when first, and how much of it in all."""

    count: int = 0
    first: float = float("nan")
    amount: float = 0.0

    def more(self, times: FloatArray, amount: float = 0.0) -> "Tally":
        """With further ones at these times."""
        if len(times) == 0:
            return self
        first = float(times[0]) if self.count == 0 else self.first
        return Tally(self.count + len(times), first, self.amount + amount)


@dataclass(frozen=True, eq=False)
class WatchState:
    """What was seen so far.

    Parameters
    ----------
    reading, run, moved : float, int, float
        The Hall probe's last reading, how often it came in a row, and how far the coil saw the field move meanwhile, T.
    highest, stuck_at : float
        Largest |reading| so far, and largest at which the probe stood still, T.
    waiting : (array, array)
        Times and normalised squares of the latest innovations, s and 1.
    xx, xy, yy : float
        Sums of products of the changes that coil (x, in T) and reference (y, in its unit) saw.
    """

    time: float = float("nan")
    voltage: float = float("nan")
    tallies: dict[str, Tally] = field(default_factory=dict)
    reading: float = float("nan")
    run: int = 0
    moved: float = 0.0
    highest: float = 0.0
    stuck_at: float = 0.0
    waiting: tuple[FloatArray, FloatArray] = field(default_factory=lambda: (np.empty(0), np.empty(0)))
    xx: float = 0.0
    xy: float = 0.0
    yy: float = 0.0


@dataclass(frozen=True)
class RecordWatch:
    """Watches a record.

    Parameters
    ----------
    reference : str or None
        The column that the coil is compared with.
    scale : float or None
        Field in T of one unit of the reference, where it is to be checked: 1 for a Hall probe beside a coil of known
        area, 1/g for a current with the ratio g. None compares the signs alone.
    currents : (float, float) or None
        Between which a field model holds, A.
    """

    area: float
    sample_time: float
    reference: Reference | None = None
    scale: float | None = None
    currents: tuple[float, float] | None = None

    def start(self) -> WatchState:
        """Nothing seen."""
        return WatchState()

    def advance(self, state: WatchState, block: CoilBlock, out: FieldBlock | None = None) -> WatchState:
        """Watch a block, and the field block that a filter made of it."""
        first = np.isnan(state.time)
        dt = np.diff(block.time, prepend=block.time[0] if first else state.time)
        before = np.concatenate([[block.voltage[0] if first else state.voltage], block.voltage[:-1]])
        rise = dt * (block.voltage + before) / (2.0 * self.area)
        tallies = dict(state.tallies)
        gap, late = dt > GAP * self.sample_time, (dt < 0.5 * self.sample_time) & (dt > 0.0)
        lost = float(np.sum(dt[gap])) - self.sample_time * int(np.sum(gap))
        _add(tallies, "gap", block.time[gap], lost)
        _add(tallies, "clock", block.time[late])
        _add(tallies, "clipped", block.time[_clipped(block.voltage)])
        if block.current is not None and self.currents is not None:
            low, high = self.currents
            slack = RANGE_SLACK * (high - low)
            outside = (block.current < low - slack) | (block.current > high + slack)
            _add(tallies, "range", block.time[outside])
        waiting = state.waiting if out is None else _watch_innovations(tallies, state.waiting, out)
        end = (float(block.time[-1]), float(block.voltage[-1]))
        state = replace(state, time=end[0], voltage=end[1], tallies=tallies, waiting=waiting)
        if block.hall is not None:
            state = self._watch_probe(state, block.time, block.hall, rise)
        reading = {"hall_T": block.hall, "current_A": block.current, None: None}[self.reference]
        return state if reading is None else self._compare(state, rise, reading)

    def findings(self, state: WatchState) -> tuple[Finding, ...]:
        """What was seen, in words."""
        tallies, found = state.tallies, []
        for code, text in _SENTENCES.items():
            source = "stuck" if code == "saturated" else code
            at_top = state.stuck_at >= (1.0 - 1e-9) * state.highest
            if source in tallies and (source != "stuck" or at_top == (code == "saturated")):
                seen = tallies[source]
                said = text.format(count=seen.count, first=f"{seen.first:.6g}", amount=f"{seen.amount:.3g}")
                found.append(Finding(code, "warning", said, _REMEDIES[code]))
        found += self._disagreement(state)
        if "innovations" in tallies:
            seen = tallies["innovations"]
            suspect = next((name for code, name in _SUSPECTS.items() if code in {one.code for one in found}), None)
            if suspect is None and self.reference == "hall_T":
                suspect = "the offset voltage (cs1-offset estimates it), or the Hall probe's drift"
            text = (
                f"The filter's innovations left their band {seen.count} times, first at {seen.first:.6g} s (squared up "
                f"to {seen.amount:.3g} times what it expects). Suspect: "
                f"{suspect or 'the relation between current and field'}."
            )
            found.append(Finding("innovations", "warning", text))
        return tuple(found)

    def _watch_probe(self, state: WatchState, time: FloatArray, hall: FloatArray, rise: FloatArray) -> WatchState:
        """Runs of one and the same reading while the coil sees the field move."""
        known = np.isfinite(hall)
        if not known.any():
            return state
        highest = max(state.highest, float(np.abs(hall[known]).max()))
        new = np.flatnonzero(hall != np.concatenate([[state.reading], hall[:-1]]))
        begins = np.concatenate([[0], new]) if len(new) == 0 or new[0] > 0 else new
        ends = np.concatenate([begins[1:], [len(hall)]])
        path = np.concatenate([[0.0], np.cumsum(rise)])
        lengths, moved = ends - begins, path[ends] - path[begins]
        if len(new) == 0 or new[0] > 0:  # the first run goes on from the block before
            lengths[0] += state.run
            moved[0] += state.moved
        stuck = (lengths * self.sample_time >= STUCK_TIME_S) & (lengths > CLIPPED_RUN)
        stuck &= np.abs(moved) > STUCK_SHARE * highest
        tallies = dict(state.tallies)
        _add(tallies, "stuck", time[begins[stuck]], float(np.sum(lengths[stuck])) * self.sample_time)
        stuck_at = max(state.stuck_at, float(np.abs(hall[begins[stuck]]).max(initial=0.0)))
        last_stuck = bool(stuck[-1])
        return replace(
            state,
            tallies=tallies,
            reading=float(hall[-1]),
            run=0 if last_stuck else int(lengths[-1]),
            moved=0.0 if last_stuck else float(moved[-1]),
            highest=highest,
            stuck_at=stuck_at,
        )

    def _compare(self, state: WatchState, rise: FloatArray, reading: FloatArray) -> WatchState:
        """Sum up what coil and reference saw of the same changes."""
        size = max(1, round(COMPARED_S / self.sample_time))
        stretches = (len(rise) - 1) // size
        if stretches < 1:
            return state
        x = rise[1 : 1 + stretches * size].reshape(stretches, size).sum(axis=1)
        y = np.diff(reading[: 1 + stretches * size : size])
        used = np.isfinite(y)
        x, y = x[used], y[used]
        return replace(state, xx=state.xx + float(x @ x), xy=state.xy + float(x @ y), yy=state.yy + float(y @ y))

    def _disagreement(self, state: WatchState) -> list[Finding]:
        """Whether coil and reference see the field move in opposite directions, or by different amounts."""
        if state.xx <= 0.0 or state.xy**2 < AGREEMENT * state.xx * state.yy:
            return []
        of_hall = self.reference == "hall_T"
        name = "Hall probe" if of_hall else "current"
        if state.xy < 0.0:
            text = (
                f"The coil sees the field fall when the {name} sees it rise: the coil (or the {name}) is wired the "
                "wrong way round."
            )
            return [Finding("sign", "warning", text, "Change the sign of its column.")]
        slope = state.xy / state.xx * (self.scale or 0.0)
        if self.scale is None or abs(slope - 1.0) <= GAIN_TOLERANCE:
            return []
        area = f"an area of {self.area / slope:.6g} m2"
        if of_hall:
            wrong, agree = "the coil's area (or the probe's gain)", f"{area} would agree"
        else:
            ratio = state.xy / state.xx
            wrong, agree = "the current-to-field ratio (or the coil's area)", f"{ratio:.6g} A/T, or {area}, would agree"
        text = f"The {name} shows {slope:.3g} times the changes that the coil sees: {wrong} is wrong; {agree}."
        return [Finding("gain", "warning", text, size=slope - 1.0)]


_SENTENCES = {
    "gap": "{count} gaps, first before {first} s, {amount} s lost in all: bridged by a straight line, and the field's "
    "uncertainty grew by what they may hide.",
    "clock": "{count} samples come after less than half a sample time, first at {first} s: the clock jumped.",
    "clipped": "{count} samples repeat the largest voltage exactly, first at {first} s: the converter clipped, and "
    "their flux is lost.",
    "saturated": "The Hall probe stood still at its largest reading, first at {first} s, for {amount} s in all, while "
    "the coil saw the field move: it saturated.",
    "stuck": "The Hall probe repeated one reading, first at {first} s, for {amount} s in all, while the coil saw the "
    "field move: it stuck.",
    "range": "{count} samples have a current outside of what the field model was made for, first at {first} s: it "
    "extrapolates there.",
}
_REMEDIES = {
    "gap": "",
    "clock": "Check the time stamps.",
    "clipped": "Choose a larger range.",
    "saturated": "Use a larger range, or leave these readings empty.",
    "stuck": "Leave these readings empty.",
    "range": "Sweep or identify up to these currents.",
}

_SUSPECTS = {
    "sign": "the sign of the coil's voltage",
    "stuck": "the Hall probe, which stuck",
    "saturated": "the Hall probe, which saturated",
    "clipped": "the coil's converter, which clipped",
    "gain": "the coil's area, or the reference's gain",
    "gap": "the gaps",
    "clock": "the clock",
    "range": "the field model, which extrapolates",
}
"""Who is suspected of large innovations, by the code of another finding; the first that applies."""


def _add(tallies: dict[str, Tally], code: str, times: FloatArray, amount: float = 0.0) -> None:
    if len(times):
        tallies[code] = tallies.get(code, Tally()).more(times, amount)


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


def _watch_innovations(
    tallies: dict[str, Tally], waiting: tuple[FloatArray, FloatArray], out: FieldBlock
) -> tuple[FloatArray, FloatArray]:
    """Hold means of normalised squares against the band; return times and squares that wait for more."""
    used = np.isfinite(out.innovation)
    times = np.concatenate([waiting[0], out.time[used]])
    squares = np.concatenate([waiting[1], out.innovation[used] ** 2 / out.innovation_variance[used]])
    whole = len(squares) // INNOVATIONS_AVERAGED * INNOVATIONS_AVERAGED
    means = squares[:whole].reshape(-1, INNOVATIONS_AVERAGED).mean(axis=1)
    outside = means > INNOVATION_BAND
    if outside.any():
        seen = tallies.get("innovations", Tally()).more(times[:whole:INNOVATIONS_AVERAGED][outside])
        tallies["innovations"] = replace(seen, amount=max(seen.amount, float(means.max())))
    return times[whole:], squares[whole:]
