"""Checks of a bench table: order of measuring, copies, stuck channels, lone outliers.

What may be wrong with a recorded time series: its clock and its sensors. Found and said, never repaired.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray, FloatArray, IntArray, even_scale
from femfit.core.results import Finding
from femfit.core.sweep_columns import is_current
from femfit.core.text import amount, counted
from femfit.tables.findings import finding
from femfit.tables.header import parts_of
from femfit.tables.measurement import BenchTable
from femfit.tables.outliers import isolated_outliers
from femfit.tables.units import CHANNELS, Channel, suspected_by_size

_LEAST_STUCK = 8
"""Assumed: consecutive equal readings from which a channel may be stuck."""

USUAL_OUTLIERS = 0.02
"""Assumed: part of a channel that a loose contact or a slip may be; more are warned of."""

_SETTINGS = frozenset({"distance_m", "branch", "frequency_Hz"})  # beside the currents
_FEW = 5
"""Assumed: other readings that show whether a channel has noise."""

_STUCK_CHANCE = 1e-3
"""Conventional: expected number of such stretches by chance, from how often repeats are equal."""

STILL_CURRENT = 0.005
"""Assumed: change of the current, over all of its range, that is the ammeter's and no step."""

_TURNS = 0.25
"""Assumed: turns over steps up to which currents were cycled; currents in random order turn at two steps of three."""

_BOTH = 0.1
"""Assumed: part of the rows whose steps must rise, and fall, and follow a step at the same distance."""

_SINGLE = 0.02
"""Assumed: steps back in a file, over its rows, up to which a clock was reset; more are a file sorted by something
else."""


def checked(table: BenchTable) -> BenchTable:
    """Set aside what cannot be right in a table, and suspect its units from the sizes of its numbers."""
    findings = suspected_by_size(table.rows)
    rows = table.rows
    for name in (name for name in table.channels if parts_of(name)[0] != "voltage_V"):  # which may be commanded
        values, stuck = _without_stuck(rows, name)
        findings += stuck
        rows = rows.assign(**{name: values})
    return replace(table, rows=rows, findings=(*table.findings, *findings))


def without_outliers(table: BenchTable, predicted: Mapping[str, FloatArray]) -> BenchTable:
    """Set aside single readings whose deviation from a model contradicts that of all neighbours.

    Without a model a steep curve's true end looks like an outlier, so that readings are compared by what the model,
    channel by channel and row by row, leaves of them; NaN where it has no prediction.
    """
    rows, findings = table.rows, []
    placed = rows[["distance_m", "current_A"]].notna().all(axis=1).to_numpy()
    settings = pd.DataFrame({"distance": even_scale(rows["distance_m"].to_numpy()), "current": rows["current_A"]})
    scaled = (settings - settings.min()) / (settings.max() - settings.min()).clip(lower=1e-300)
    places = scaled.assign(branch=0.1 * rows["branch"]).to_numpy()  # the branches a little apart
    for name in (name for name in table.channels if name in predicted):
        values, expected = rows[name].to_numpy(copy=True), predicted[name]
        readable = np.flatnonzero(np.isfinite(values - expected) & placed)
        if len(readable) < 2:
            continue
        # The smallest usual distance between the levels of a coarse channel
        levels = np.unique(values[readable])
        step = float(np.quantile(np.diff(levels), 0.1)) if 1 < len(levels) < 0.9 * len(readable) else 0.0
        run, residual = pd.factorize(rows["run"].to_numpy()[readable])[0], (values - expected)[readable]
        lone = readable[isolated_outliers(residual, places[readable], run, expected[readable], step)]
        if not len(lone):
            continue
        shown = [
            f"{values[k]:.5g} at {1e3 * rows['distance_m'][k]:.4g} mm and {rows['current_A'][k]:.4g} A "
            f"(run {rows['run'][k]:g}, order {rows['order'][k]:g})"
            for k in lone[:3].tolist()
        ]
        facts = {"readings": len(lone), "shown": "; ".join(shown + ["and so on"] * (len(lone) > 3))}
        code = "outliers many" if len(lone) > USUAL_OUTLIERS * len(readable) else "outliers"
        findings.append(finding(code, size=float(len(lone)), column=name, **facts))
        values[lone] = np.nan
        rows = rows.assign(**{name: values})
    return replace(table, rows=rows, findings=(*table.findings, *findings))


def without_copies(rows: pd.DataFrame, columns: tuple[str, ...]) -> tuple[pd.DataFrame, list[Finding]]:
    """Keep rows once, where the same row stands twice: a file joined with itself would make the noise look smaller.

    Without numbers of run and order rows may be equal by chance, and are kept; but not where all of a table follows
    itself once more. Of a record whole segments are copies.
    """
    given = rows[list(columns)].reset_index(drop=True)
    copies = given.duplicated().to_numpy()
    if "segment" in rows:
        copies = pd.Series(copies).groupby(rows["segment"].to_numpy()).transform("all").to_numpy()
    elif not {"run", "order"} <= set(columns):
        as_first = (given == given.iloc[0]) | (given.isna() & given.iloc[0].isna())
        length = int(np.r_[np.flatnonzero(as_first.all(axis=1)), len(given)][1])
        before = given[: len(given) - length]
        pasted = _LEAST_STUCK <= length <= len(given) // 2 and given[length:].reset_index(drop=True).equals(before)
        numbers = before.to_numpy(dtype=np.float64).ravel()
        # Three digits may repeat by themselves
        pasted = pasted and any(float(f"{x:.3g}") != x for x in numbers[np.isfinite(numbers)])
        copies = (np.arange(len(given)) >= length) & pasted
    count = int(copies.sum())
    findings = [finding("copies", size=float(count), rows=count)] if count else []
    return rows[~copies].reset_index(drop=True), findings


def _without_stuck(rows: pd.DataFrame, name: str) -> tuple[FloatArray, list[Finding]]:
    """A channel without stretches of one and the same reading over settings that change, where others show its noise.

    Where a reading equals the one before with the chance p, n p^(L - 1) stretches of n readings are longer than L by
    chance. Without a current, where there is one elsewhere, what is computed may be constant; a reading of zero may be
    below the channel's step.
    """
    values = rows[name].to_numpy().copy()
    readable = np.flatnonzero(np.isfinite(values))
    read, rows = values[readable], rows.iloc[readable]
    length, stretch = equal_stretches(read, rows["run"].to_numpy())
    settings = [name for name in map(str, rows) if is_current(name) or name in _SETTINGS]
    driven = (rows[[name for name in settings if is_current(name)]].fillna(0.0) != 0.0).any(axis=1).to_numpy()
    moves = (rows[settings].diff().fillna(0.0) != 0.0).any(axis=1).to_numpy() & (driven | ~driven.any())
    steps = np.diff(read)[length[stretch[1:]] < _LEAST_STUCK]
    equal = (np.sum(steps == 0.0) + 1.0) / (len(steps) + 2.0)
    least = max(_LEAST_STUCK, 1.0 + np.log(_STUCK_CHANCE / max(len(read), 1)) / np.log(equal))
    long = np.bincount(stretch, moves & (read != 0.0), len(length)) >= least
    lengths_of: dict[float, list[int]] = {}
    for number in np.flatnonzero(long & (len(steps) >= _FEW)):
        members = np.flatnonzero(stretch == number)
        values[readable[members]] = np.nan
        lengths_of.setdefault(float(read[members[0]]), []).append(len(members))
    return values, [
        finding("stuck bench", size=float(sum(counts)), column=name, value=value, rows=" and ".join(map(str, counts)))
        for value, counts in lengths_of.items()
    ]


def in_measuring_order(rows: pd.DataFrame, has_run: bool) -> tuple[pd.DataFrame, list[Finding]]:
    """Put rows of one run together, in the order of measuring: a believable one, else that of the file.

    ``order`` counts from 0 in a run where it is missing or not believable.
    """
    rows, findings = rows.copy(), []
    order = rows["order"].to_numpy()
    if not has_run and np.isfinite(order).all() and len(np.unique(order)) < len(order):
        rows["run"] = 1.0 + np.cumsum(np.diff(order, prepend=order[0]) < 0.0)
        if rows["run"].iloc[-1] > 1.0:
            findings.append(finding("order anew", column="order", times=int(rows["run"].iloc[-1] - 1)))
    pieces = []
    for _, piece in rows.groupby("run", sort=False):
        believable, odd = _clock(piece["order"].to_numpy(), piece["run"].iloc[0])
        findings += odd
        counted_anew = piece.assign(order=np.arange(len(piece), dtype=np.float64))
        pieces.append(piece.sort_values("order", kind="stable") if believable else counted_anew)
    return pd.concat(pieces, ignore_index=True), findings


def _clock(order: FloatArray, run: float) -> tuple[bool, list[Finding]]:
    """Whether a run can be sorted by its order, and what is odd about that."""
    if np.isnan(order).any():
        return False, [] if np.isnan(order).all() else [finding("order gaps", column="order", run=run)]
    back, twice = int(np.sum(np.diff(order) < 0.0)), len(order) - len(np.unique(order))
    numbered = bool(np.all(order == np.round(order)))
    if not twice and (numbered or not 0 < back <= max(1.0, _SINGLE * len(order))):
        return True, []
    what = f"goes back {counted(back, 'time')}" if back else f"holds {counted(twice, 'number')} twice"
    return False, [finding("order reset", column="order", run=run, fault=what)]


def branch_from_order(rows: pd.DataFrame) -> tuple[FloatArray | None, list[Finding]]:
    """Read the branch of every row from the order of measuring, where the currents of a table go up and down.

    +1 while the current rises, -1 while it falls, 0 where it does not change; None where it was not cycled.
    """
    current = rows["current_A"]
    # Rows that follow each other in one run at one distance
    place = (rows[["run", "distance_m"]].diff() != 0.0).any(axis=1).cumsum()
    steps = current.groupby(place).diff()
    signs = np.sign(steps.where(steps.abs() > STILL_CURRENT * (current.max() - current.min())))
    moved = signs.dropna()
    turns = int((moved.groupby(place).diff().fillna(0.0) != 0.0).sum())
    could_turn = len(moved) - place[moved.index].nunique()
    # A step's sign holds until the next step, and back to the place's first row
    branch = signs.groupby(place).ffill().groupby(place).bfill().fillna(0.0).to_numpy()
    rising, falling = int(np.sum(branch > 0.0)), int(np.sum(branch < 0.0))
    # Rows in random order seldom make two steps on end at one distance, and then show no turns either
    if min(rising, falling, could_turn) < _BOTH * len(rows) or turns > _TURNS * (rising + falling):
        return None, []
    return branch, [finding("branch-assumed", column="branch")]


_SHARE = 0.1
"""Conventional: part of the steps that stand still from which the stamps are coarse; fewer are single faults."""

_PAUSE = 5.0
"""Assumed: a step of the clock longer than this many times the usual longest (95 %) one is a gap."""

_LEAST_STUCK_SAMPLES, _MUCH_LONGER = 50, 20
"""Assumed: samples of one and the same reading, and how much longer than the channel's usual ones that must be."""

_MOST_IMPOSSIBLE = 0.02
"""Assumed: largest part of a channel that can be impossible by single faults."""

_LEAST_CLIPPED, _PILED = 20, 5
"""Assumed: samples at the end of a range, and how many times those of the next hundredth of the range that must be."""


def check_clock(rows: pd.DataFrame, source: str = "the record") -> tuple[IntArray, list[Finding]]:
    """Find where a clock jumps back, stands still or pauses, and number the segments between."""
    time, run = rows["time_s"].to_numpy(), rows["run"].to_numpy()
    step, same = np.diff(time), np.diff(run) == 0.0
    forward = step[same & (step > 0.0)]
    if not len(forward):
        raise TableError(
            f"The time_s of {source} rises nowhere within a run: {counted(len(rows), 'sample')} from {time.min():.6g} "
            f"s to {time.max():.6g} s. Repair the clock, or leave the column time_s out if these are readings at rest."
        )
    if (step[same] == 0.0).mean() > _SHARE:
        raise TableError(
            f"The clock of {source} gives several rows one stamp, {amount(float(np.median(forward)), 's')} apart. "
            "Record finer stamps, or put times at the fixed rate of the recorder into time_s."
        )
    usual = float(np.quantile(forward, 0.95))
    back, pause = same & (step <= 0.0), same & (step > _PAUSE * usual)
    findings = []
    for where, fault in ((back, "does not run on"), (pause, "pauses")):
        if where.any():
            first = int(np.flatnonzero(where)[0])
            facts = {"places": int(where.sum()), "begin": time[first], "end": time[first + 1], "run": run[first]}
            findings.append(finding("clock", size=float(where.sum()), column="time_s", fault=fault, **facts))
    breaks = np.concatenate([[False], back | pause | ~same])
    return np.cumsum(breaks), findings


def check_readings(rows: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding], set[str]]:
    """Set aside what is impossible, stuck or clipped, as NaN; and which channels are clipped somewhere.

    Of what no actuator has, such as 1e30 A, single numbers are set aside; many of them are a wrong unit, and stay.
    """
    rows, findings, time, clipped = rows.copy(), [], rows["time_s"].to_numpy(), set[str]()
    channels = {str(name): CHANNELS.get(parts_of(str(name))[0], Channel()) for name in rows}
    for name, channel in channels.items():
        values = rows[name].to_numpy(copy=True)
        beyond = np.abs(values) > channel.possible
        if beyond.any() and beyond.mean() <= _MOST_IMPOSSIBLE:
            first = int(np.argmax(beyond))
            facts = {"readings": int(beyond.sum()), "limit": channel.possible, "first": values[first]}
            size = float(beyond.sum())
            findings.append(finding("outliers impossible", size=size, column=name, time=time[first], **facts))
            rows[name] = np.where(beyond, np.nan, values)
    for name in (name for name, channel in channels.items() if channel.sensor):
        values = rows[name].to_numpy(copy=True)
        readable = np.isfinite(values)
        if not readable.any():
            continue
        if count := int((~readable).sum()):
            findings.append(finding("cells missing", size=count, column=name, cells=count))
        ended, (length, stretch) = _clipped(values), equal_stretches(values)
        usual = float(np.quantile(length, 0.95)) if len(length) > 1 else 0.0  # nothing moves it at all
        long = length > max(_LEAST_STUCK_SAMPLES, _MUCH_LONGER * usual)
        stuck = long[stretch] & readable & (values != 0.0)  # a current that is off rests at zero
        clipped |= {name} if ended.any() else set()
        for faulty, fault in ((stuck & ~ended, "stuck"), (ended, "clipped")):
            if faulty.any():
                levels = [f"{level:.4g}" for level in np.unique(values[faulty])]
                shown = " and ".join(levels[:2] + ["others"] * (len(levels) > 2))
                facts = {"samples": int(faulty.sum()), "levels": shown, "time": time[np.argmax(faulty)]}
                findings.append(finding(fault, size=float(faulty.sum()), column=name, **facts))
                values[faulty] = np.nan
        rows[name] = values
    return rows, findings, clipped


def equal_stretches(values: FloatArray, run: FloatArray | None = None) -> tuple[IntArray, IntArray]:
    """Length of each stretch of one and the same reading, within a run, and the stretch of each sample."""
    changes = np.diff(values, prepend=values[:1]) != 0.0
    if run is not None:
        changes |= np.diff(run, prepend=run[:1]) != 0.0
    stretch = np.cumsum(changes)
    return np.bincount(stretch), stretch


def _clipped(values: FloatArray) -> BoolArray:
    """Samples at an end of the range that are far more than those beside it."""
    result = np.zeros(len(values), dtype=bool)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    length, stretch = equal_stretches(values)
    for end in (end for end in (low, high) if high > low and end != 0.0):
        at_end, apart = values == end, np.abs(values - end)
        next_level = np.nanmin(apart[~at_end])  # of a coarse converter
        near = max(int((apart[~at_end] <= 0.01 * (high - low)).sum()), int((apart == next_level).sum()))
        lasting = int(length[stretch[at_end]].max()) >= _LEAST_CLIPPED // 2
        if lasting and at_end.sum() >= max(_LEAST_CLIPPED, _PILED * near + 1):
            result |= at_end
    return result
