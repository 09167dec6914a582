"""What may be wrong with a coil record, watched while it streams past the filter.

Each finding is a sentence that names the suspect. None stops the integration: a gap, for one, is bridged by the
trapezoid and paid for in variance.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.integrate.field_block import FieldBlock
from femfit.integrate.increments import GAP
from femfit.tables.coil_block import CoilBlock

CLIPPED_RUN = 4
"""So many equal samples in a row at the largest |voltage| of a block look clipped."""

STUCK_TIME = 0.05
"""Seconds for which a living probe never repeats a reading exactly."""

STUCK_SHARE = 0.01
"""A probe is stuck if the coil saw the field move by this share of the largest reading meanwhile."""

GAIN_TOLERANCE = 0.05
"""Relative disagreement of coil and reference over the ramps that is put down to area or gain."""

BAND = 9.0
"""Mean squared innovation over its variance (1 in a true filter) beyond which innovations have left their band."""

_AVERAGED = 50  # innovations whose mean square is held against the band
_CHUNK = 0.1  # seconds over which changes of coil and reference are compared
_BEYOND = 0.01  # of its range of currents by which a field model may be exceeded
_AGREE = 0.8  # squared correlation from which the two changes are the same thing


@dataclass(frozen=True)
class Finding:
    """Something wrong with a record.

    Parameters
    ----------
    kind : str
        ``gap``, ``clock``, ``clipped``, ``stuck``, ``saturated``, ``range``, ``sign``, ``gain``,
        ``innovations`` or ``plateau``.
    sentence : str
        What, where, how often, and who is suspected.
    """

    kind: str
    sentence: str


@dataclass(frozen=True)
class Tally:
    """How often something was seen, and when first.

    Parameters
    ----------
    amount : float
        Their size, in the unit of what was seen.
    """

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
        The reference's last reading, how often it came in a row, and how far the coil saw the field move meanwhile, T.
    highest, stuck_at : float
        Largest |reading| so far, and largest at which the probe stood still, T.
    waiting : (array, array)
        Times and normalised squares of the latest innovations, s and 1.
    xx, xy, yy : float
        Sums of products of the changes that coil (x) and reference (y) saw, T^2.
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
    current_to_field : float
        g in A/T, to compare with a current where there is no Hall probe.
    currents : (float, float) or None
        Between which a field model holds, A.
    """

    area: float
    sample_time: float
    current_to_field: float = 316.0
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
            slack = _BEYOND * (high - low)
            outside = (block.current < low - slack) | (block.current > high + slack)
            _add(tallies, "range", block.time[outside])
        waiting = state.waiting if out is None else _watch_innovations(tallies, state.waiting, out)
        end = (float(block.time[-1]), float(block.voltage[-1]))
        state = replace(state, time=end[0], voltage=end[1], tallies=tallies, waiting=waiting)
        if block.hall is not None:
            state = self._watch_probe(state, block.time, block.hall, rise)
        reference = block.hall if block.hall is not None else block.current
        if reference is None:
            return state
        scale = 1.0 if block.hall is not None else 1.0 / self.current_to_field
        return self._compare(state, rise, reference * scale)

    def findings(self, state: WatchState, of_hall: bool) -> tuple[Finding, ...]:
        """Sentences; ``of_hall`` says whether the reference was a Hall probe."""
        tallies, found = state.tallies, []
        for kind, text in _SENTENCES.items():
            source = "stuck" if kind == "saturated" else kind
            at_top = state.stuck_at >= (1.0 - 1e-9) * state.highest
            if source in tallies and (source != "stuck" or at_top == (kind == "saturated")):
                seen = tallies[source]
                found.append(
                    Finding(kind, text.format(count=seen.count, first=f"{seen.first:.6g}", amount=f"{seen.amount:.3g}"))
                )
        found += self._gain_findings(state, of_hall)
        if "innovations" in tallies:
            seen = tallies["innovations"]
            suspect = _suspect([finding.kind for finding in found], of_hall)
            found.append(
                Finding(
                    "innovations",
                    f"The filter's innovations left their band {seen.count} times, first at {seen.first:.6g} s "
                    f"(squared up to {seen.amount:.3g} times what it expects). Suspect: {suspect}.",
                )
            )
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
        stuck = (lengths * self.sample_time >= STUCK_TIME) & (lengths > CLIPPED_RUN)
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

    def _compare(self, state: WatchState, rise: FloatArray, reference: FloatArray) -> WatchState:
        """Sum up what coil and reference saw of the same changes."""
        size = max(1, round(_CHUNK / self.sample_time))
        chunks = (len(rise) - 1) // size
        if chunks < 1:
            return state
        x = rise[1 : 1 + chunks * size].reshape(chunks, size).sum(axis=1)
        y = np.diff(reference[: 1 + chunks * size : size])
        used = np.isfinite(y)
        x, y = x[used], y[used]
        return replace(state, xx=state.xx + float(x @ x), xy=state.xy + float(x @ y), yy=state.yy + float(y @ y))

    def _gain_findings(self, state: WatchState, of_hall: bool) -> list[Finding]:
        if state.xx <= 0.0 or state.xy**2 < _AGREE * state.xx * state.yy:
            return []
        slope, name = state.xy / state.xx, "Hall probe" if of_hall else "current"
        if slope < 0.0:
            return [
                Finding(
                    "sign",
                    f"The coil sees the field fall when the {name} sees it rise: the coil (or the {name}) is wired the "
                    "wrong way round. Change the sign of its column.",
                )
            ]
        if of_hall and abs(slope - 1.0) > GAIN_TOLERANCE:
            return [
                Finding(
                    "gain",
                    f"The Hall probe sees {slope:.3g} times the changes that the coil sees: the coil's area (or the "
                    f"probe's gain) is wrong; an area of {self.area / slope:.6g} m2 would agree.",
                )
            ]
        return []


_SENTENCES = {
    "gap": "{count} gaps, first before {first} s, {amount} s lost in all: bridged by a straight line, and the field's "
    "uncertainty grew by what they may hide.",
    "clock": "{count} samples come after less than half a sample time, first at {first} s: the clock jumped. Check the "
    "time stamps.",
    "clipped": "{count} samples repeat the largest voltage exactly, first at {first} s: the converter clipped, and "
    "their flux is lost. Choose a larger range.",
    "saturated": "The Hall probe stood still at its largest reading, first at {first} s, for {amount} s in all, while "
    "the coil saw the field move: it saturated. Use a larger range, or leave these readings empty.",
    "stuck": "The Hall probe repeated one reading, first at {first} s, for {amount} s in all, while the coil saw the "
    "field move: it stuck. Leave these readings empty.",
    "range": "{count} samples have a current outside of what the field model was made for, first at {first} s: it "
    "extrapolates there. Sweep or identify up to these currents.",
}


def no_plateau(still_A: float) -> Finding:
    """What is said where ffa2 found no plateau.

    Parameters
    ----------
    still_A : float
        Limit of a plateau's movement, A.
    """
    return Finding(
        "plateau",
        f"ffa2 found no settled plateau, on which the current moves by less than {still_A:g} A in a second: nothing "
        "was taken off, and this is the plain integral. Give --still-A, a shorter --settling-s, or another method.",
    )


def _add(tallies: dict[str, Tally], kind: str, times: FloatArray, amount: float = 0.0) -> None:
    if len(times):
        tallies[kind] = tallies.get(kind, Tally()).more(times, amount)


def _clipped(voltage: FloatArray) -> BoolArray:
    """Samples in runs of equal values at the largest |voltage| of the block, as a mask."""
    highest = float(np.abs(voltage).max())
    at_top = np.abs(voltage) == highest
    none = np.zeros(len(voltage), dtype=np.bool_)
    if highest == 0.0 or int(at_top.sum()) < CLIPPED_RUN:
        return none
    edges = np.flatnonzero(np.diff(at_top, prepend=False, append=False))
    begins, ends = edges[::2], edges[1::2]
    long = ends - begins >= CLIPPED_RUN
    # A coarse converter repeats the top of quiet noise too; clipping cuts a signal of many steps.
    if not long.any() or len(np.unique(voltage)) < 4 * CLIPPED_RUN:
        return none
    for begin, end in zip(begins[long], ends[long], strict=True):
        none[begin:end] = True
    return none


def _watch_innovations(
    tallies: dict[str, Tally], waiting: tuple[FloatArray, FloatArray], out: FieldBlock
) -> tuple[FloatArray, FloatArray]:
    """Means of fifty normalised squares against the band; returns times and squares that wait for more."""
    used = np.isfinite(out.innovation)
    times = np.concatenate([waiting[0], out.time[used]])
    squares = np.concatenate([waiting[1], out.innovation[used] ** 2 / out.innovation_variance[used]])
    whole = len(squares) // _AVERAGED * _AVERAGED
    means = squares[:whole].reshape(-1, _AVERAGED).mean(axis=1)
    outside = means > BAND
    if outside.any():
        seen = tallies.get("innovations", Tally()).more(times[:whole:_AVERAGED][outside])
        tallies["innovations"] = replace(seen, amount=max(seen.amount, float(means.max())))
    return times[whole:], squares[whole:]


def _suspect(kinds: list[str], of_hall: bool) -> str:
    """Whom the other findings point to."""
    names = {
        "sign": "the sign of the coil's voltage",
        "stuck": "the Hall probe, which stuck",
        "saturated": "the Hall probe, which saturated",
        "clipped": "the coil's converter, which clipped",
        "gain": "the coil's area",
        "gap": "the gaps",
        "clock": "the clock",
        "range": "the field model, which extrapolates",
    }
    for kind, name in names.items():
        if kind in kinds:
            return name
    if of_hall:
        return "the offset voltage (cs1-offset estimates it), or the Hall probe's drift"
    return "the relation between current and field"
