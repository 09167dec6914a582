"""Checks of a bench table: order of measuring, copies, stuck channels, lone outliers."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy import stats

from femfit.core.numerics import BoolArray, FloatArray, IntArray, even_scale
from femfit.core.results import Finding
from femfit.core.sweep_columns import is_current
from femfit.core.text import counted
from femfit.tables.findings import finding
from femfit.tables.header import parts_of
from femfit.tables.measurement import CHANNELS, BenchTable
from femfit.tables.outliers import isolated_outliers
from femfit.tables.time_series_checks import NORMAL_MEDIAN, equal_stretches
from femfit.tables.units import suspected_by_size

_LEAST_COPIES = 5
"""Assumed: rows on end that equal earlier ones and are copies, where no order tells: single readings may be equal
by chance."""

_NUMBERS = ("run", "mount", "order")
"""Columns that number rows, and differ in a copy that somebody numbered anew."""

_COARSE = 3.0
"""Assumed: steps of a channel below which its scatter, from readings that are not equal, is no more than its steps."""

_LEAST_STUCK = 5
"""Assumed: consecutive equal readings from which a column may be stuck."""

_COMMANDED = frozenset(("distance_m", "current_A", "voltage_V"))
"""What somebody may set, so that equal numbers are none of a sensor."""

_STUCK_CHANCE = 1e-3
"""Conventional: expected number of such stretches by chance, from how often repeats are equal."""

_REPEAT = 0.01
"""Assumed: part of a setting's range within which readings repeat it."""

_FEW_REPEATS, _STEPS = 5, 10
"""Assumed: repeats that show whether a column has noise, and the different sizes that their differences then have; a
staircase that somebody commands has few."""

_ONE_WAY = 0.1
"""Assumed: part of the repeats that must differ upwards, and downwards, for a noise; a fine sweep goes one way."""

STILL_CURRENT = 0.005
"""Assumed: change of the current, over all of its range, that is the ammeter's and no step."""

_TURNS = 0.25
"""Assumed: turns over steps up to which currents were cycled; currents in random order turn at two steps of three."""

_BOTH = 0.1
"""Assumed: part of the rows whose steps must rise, and fall, and follow a step at the same distance."""

_FEW = 0.02
"""Assumed: steps back in a file, over its rows, up to which a clock was reset; more are a file sorted by something
else."""


def checked(table: BenchTable) -> BenchTable:
    """Set aside what cannot be right in a table, and suspect its units from the sizes of its numbers."""
    findings = suspected_by_size(table.rows)
    rows = table.rows
    for name in dict.fromkeys((*table.channels, "distance_m", *filter(is_current, table.given))):
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
    for name in (name for name in table.channels if name in predicted):
        values = rows[name].to_numpy().copy()
        residual = values - predicted[name]
        readable = np.flatnonzero(np.isfinite(residual) & rows[["distance_m", "current_A"]].notna().all(axis=1))
        if len(readable) < 2:
            continue
        run = pd.factorize(rows["run"].to_numpy()[readable])[0]
        places, expected = _places(rows)[readable], predicted[name][readable]
        lone = readable[isolated_outliers(residual[readable], places, run, expected, _step(values[readable]))]
        if not len(lone):
            continue
        shown = "; ".join(
            f"{values[k]:.5g} at {1e3 * rows['distance_m'][k]:.4g} mm and {rows['current_A'][k]:.4g} A "
            f"(run {rows['run'][k]:g}, order {rows['order'][k]:g})"
            for k in lone[:3].tolist()
        ) + ("; and so on" if len(lone) > 3 else "")
        findings.append(finding("outliers", size=float(len(lone)), column=name, readings=len(lone), shown=shown))
        values[lone] = np.nan
        rows = rows.assign(**{name: values})
    return replace(table, rows=rows, findings=(*table.findings, *findings))


def without_copies(rows: pd.DataFrame, columns: tuple[str, ...]) -> tuple[pd.DataFrame, list[Finding]]:
    """Keep rows once, where the same row stands twice: a file joined with itself would make the noise look smaller.

    Single rows that could be equal by chance are kept.
    """
    channels = [name for name in columns if parts_of(name)[0] in CHANNELS]
    copies = rows.duplicated(subset=list(columns)).to_numpy()
    if not {"run", "order"} <= set(columns):
        block = np.cumsum(np.concatenate([[False], copies[1:] != copies[:-1]]))
        copies = copies & (np.bincount(block)[block] >= _LEAST_COPIES)
        if _equal_by_chance(rows, channels, copies, untold=False):
            copies = np.zeros(len(rows), dtype=bool)
    renumbered = rows.duplicated(subset=[name for name in columns if name not in _NUMBERS]).to_numpy() & ~copies
    if _equal_by_chance(rows, channels, renumbered, untold=len(channels) == 1):
        renumbered = np.zeros(len(rows), dtype=bool)
    numbers, findings = ", ".join(name for name in _NUMBERS if name in columns), []
    for which, but in ((copies, ""), (renumbered, f" but {numbers}")):
        count = int(which.sum())
        if count:
            findings.append(finding("copies", size=float(count), rows=count, but=but))
    return rows[~(copies | renumbered)].reset_index(drop=True), findings


def _equal_by_chance(rows: pd.DataFrame, channels: Sequence[str], equal: BoolArray, *, untold: bool) -> bool:
    """Whether so many rows may equal earlier ones of their setting because the channels are rounded.

    Only readings that stand at no other setting say anything. Two readings of a setting that differ by s (median) are
    rounded to the same step q with the chance q / (s sqrt(2 pi)), of several channels the product; a channel with
    s < 3 q is too coarse to tell s. Where all repeats are equal nothing does, and ``untold`` is returned.
    """
    setting = rows.groupby(_settings(rows), dropna=False).ngroup()
    elsewhere = setting.groupby([rows[name] for name in channels], dropna=False).transform("nunique").to_numpy() > 1
    count = int(np.sum(equal & ~elsewhere))
    if count < _LEAST_COPIES:
        return True
    rest, (order, follows) = rows[~equal], _pairs(setting[~equal])
    if not follows.any():
        return untold
    chance = 1.0
    for name in channels:
        values = rest[name].to_numpy()
        differences = np.abs(np.diff(values[order])[follows])
        steps = np.diff(np.unique(values[np.isfinite(values)]))
        if np.isfinite(differences).any() and len(steps):
            scatter = float(np.nanmedian(differences)) / NORMAL_MEDIAN
            chance *= steps.min() / (scatter * np.sqrt(2.0 * np.pi)) if scatter >= _COARSE * steps.min() else 1.0
    of_setting = np.bincount(setting.to_numpy()).astype(np.float64)
    expected = chance * float(np.sum(of_setting * (of_setting - 1.0)) / 2.0)
    return bool(stats.poisson.sf(count - 1, expected) > _STUCK_CHANCE)


def _without_stuck(rows: pd.DataFrame, name: str) -> tuple[FloatArray, list[Finding]]:
    """A column without stretches of one and the same reading, where its other readings show that it has noise.

    What is commanded, or rounded so that repeats are equal, may stay at one number for long. Where repeats are equal
    with the chance p, n p^(L - 1) stretches of n readings are longer than L by chance. Where nothing is repeated, a
    channel that nobody commands may be stuck over settings that change.
    """
    values = rows[name].to_numpy().copy()
    readable = np.flatnonzero(np.isfinite(values))
    read, rows = values[readable], rows.iloc[readable]
    length, stretch = equal_stretches(read, rows["run"].to_numpy())
    others = rows[length[stretch] < _LEAST_STUCK]
    repeats = _repeats(others, name, float(np.ptp(read)) if len(read) else 0.0)
    if len(repeats) < _FEW_REPEATS and parts_of(name)[0] not in _COMMANDED:
        repeats = np.diff(others[name].to_numpy())
        moves = (rows[_settings(rows)].diff().fillna(0.0) != 0.0).any(axis=1)
        driven = (rows.filter(regex="^current_.*A$").fillna(0.0) != 0.0).any(axis=1)
        moves &= driven | (read != 0.0)  # without a current a computed force is exactly zero
        length = np.bincount(stretch, moves.to_numpy(), len(length))
    equal = (np.sum(repeats == 0.0) + 1.0) / (len(repeats) + 2.0)
    least = max(_LEAST_STUCK, 1.0 + np.log(_STUCK_CHANCE / max(len(read), 1)) / np.log(equal))
    lengths_of: dict[float, list[int]] = {}
    for number in np.flatnonzero((length >= least) & (len(repeats) >= _FEW_REPEATS)):
        members = np.flatnonzero(stretch == number)
        values[readable[members]] = np.nan
        lengths_of.setdefault(float(read[members[0]]), []).append(len(members))
    return values, [
        finding("stuck bench", size=float(sum(counts)), column=name, value=value, rows=" and ".join(map(str, counts)))
        for value, counts in lengths_of.items()
    ]


def _repeats(rows: pd.DataFrame, name: str, span: float) -> FloatArray:
    """Differences between readings of one setting; of what can be commanded none where they show no noise.

    Readings of a channel are repeats where their settings hardly differ, those of a setting where they follow each
    other and hardly differ. A noise goes up and down, by ever other steps.
    """
    of_setting, commanded = parts_of(name)[0] not in CHANNELS, parts_of(name)[0] in _COMMANDED
    keys = rows[["run"] if of_setting else _settings(rows)].drop(columns="branch" if commanded else [], errors="ignore")
    keys = keys.fillna(0.0)
    for key in keys.columns.difference(["run", "branch", "frequency_Hz"]):
        keys[key] = np.round(keys[key] / max(_REPEAT * float(np.ptp(keys[key])), 1e-300)) if len(keys) else keys[key]
    order, same = _pairs(keys.groupby(list(keys)).ngroup())
    repeats = np.diff(rows[name].to_numpy()[order])[same]
    repeats = repeats[np.abs(repeats) <= _REPEAT * span] if of_setting else repeats
    sizes = len(np.unique(np.round(np.abs(repeats) / max(span, 1e-300), 9)))
    ways = [float(np.mean(sign * repeats > 0.0)) for sign in (1.0, -1.0)] if len(repeats) else [0.0]
    noisy = min(ways) >= _ONE_WAY and sizes >= min(_STEPS, len(repeats) // 2)
    return repeats if noisy or not commanded else repeats[:0]


def _pairs(setting: "pd.Series[int]") -> tuple[IntArray, BoolArray]:
    """The readings in the order of their settings, and whether each but the first is of the setting before it."""
    number = setting.to_numpy()
    order = np.argsort(number, kind="stable")
    return order, np.diff(number[order]) == 0


def _settings(rows: pd.DataFrame) -> list[str]:
    """The columns of a bench table that say at which setting a reading was taken."""
    return [str(name) for name in rows if is_current(str(name)) or name in {"distance_m", "branch", "frequency_Hz"}]


def _places(rows: pd.DataFrame) -> FloatArray:
    """Settings scaled to 0..1, the branches a little apart."""
    distance = rows["distance_m"].to_numpy()
    scaled = []
    for x in (even_scale(distance), rows["current_A"].to_numpy()):
        low, high = (np.nanmin(x), np.nanmax(x)) if np.isfinite(x).any() else (0.0, 0.0)
        scaled.append((x - low) / max(high - low, 1e-300))
    return np.column_stack([*scaled, 0.1 * rows["branch"].to_numpy()])


def _step(values: FloatArray) -> float:
    """A channel's quantisation: the smallest usual distance between the levels of a coarse channel, else 0."""
    levels = np.unique(values)
    return float(np.quantile(np.diff(levels), 0.1)) if 1 < len(levels) < 0.9 * len(values) else 0.0


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
    for run in pd.unique(rows["run"]):
        piece = rows[rows["run"] == run]
        moments, believable = _clock(piece["order"].to_numpy(), run)
        findings += moments
        if believable:
            piece = piece.sort_values("order", kind="stable")
        else:
            piece = piece.assign(order=np.arange(len(piece), dtype=np.float64))
        pieces.append(piece)
    return pd.concat(pieces, ignore_index=True), findings


def _clock(order: FloatArray, run: float) -> tuple[list[Finding], bool]:
    """What is odd about a run's order, and whether it can be sorted by."""
    if np.isnan(order).all():
        return [], False
    steps = np.diff(order)
    if np.isnan(order).any():
        return [finding("order gaps", column="order", run=run)], False
    back = np.flatnonzero(steps < 0.0)
    twice = len(order) - len(np.unique(order))
    numbered = bool(np.all(order == np.round(order)))
    if twice or (not numbered and 0 < len(back) <= max(1.0, _FEW * len(order))):
        what = f"goes back {counted(len(back), 'time')}" if len(back) else f"holds {counted(twice, 'number')} twice"
        return [finding("order reset", column="order", run=run, fault=what)], False
    return [], True


def branch_from_order(rows: pd.DataFrame) -> tuple[FloatArray | None, list[Finding]]:
    """Read the branch of every row from the order of measuring, where the currents of a table go up and down.

    +1 while the current rises, -1 while it falls, 0 where it does not change; None where it was not cycled.
    """
    current = rows["current_A"].to_numpy()
    still = STILL_CURRENT * float(np.nanmax(current) - np.nanmin(current)) if np.isfinite(current).any() else 0.0
    branch, turns, could_turn = np.zeros(len(rows)), 0, 0
    keys = rows[["run", "distance_m"]].to_numpy()
    breaks = np.flatnonzero((keys[1:] != keys[:-1]).any(axis=1)) + 1
    for place in np.split(np.arange(len(rows)), breaks):  # rows that follow each other in one run at one distance
        steps = np.diff(current[place])
        moved = np.flatnonzero(np.abs(steps) > still)
        if not len(moved):
            continue
        # A step's sign holds until the next step, and back to the stretch's first row
        signs = np.sign(steps[moved])
        turns += int(np.count_nonzero(np.diff(signs)))
        could_turn += len(moved) - 1
        before = np.searchsorted(moved, np.arange(len(place)) - 1, side="right") - 1
        branch[place] = signs[np.maximum(before, 0)]
    rising, falling = int(np.sum(branch > 0.0)), int(np.sum(branch < 0.0))
    # Rows in random order seldom make two steps on end at one distance, and then show no turns either
    if min(rising, falling, could_turn) < _BOTH * len(rows) or turns > _TURNS * (rising + falling):
        return None, []
    return branch, [finding("branch-assumed", column="branch")]
