"""Checks of measured tables: each a function of a frame in SI, and of what a model says beside it or None.

A check returns findings. What it sets aside, NaN in place of a reading or a row that is left out, is said and done by
its finding: a :class:`Change`. Checks of imported sweeps stand in ``sweep_checks.py``, those of
a record beside a model in ``estimate/record_checks.py``.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from math import comb

import numpy as np
import pandas as pd

from femfit.core.numerics import BoolArray, FloatArray, IntArray, robust_deviation
from femfit.core.results import Finding
from femfit.core.sweep_columns import is_current
from femfit.tables.findings import finding
from femfit.tables.header import parts_of
from femfit.tables.units import (
    CHANNELS,
    LEAST_READINGS,
    OTHER_SIGN,
    Channel,
    common_factors,
    other_sign,
    possible_range,
    suspicion,
)

_KELVIN = (200.0, 400.0)
"""Assumed: temperatures between these are more likely kelvins than degrees."""

_LARGEST_STEP_S = 0.5
"""Assumed: a usual step of a record's clock above it is more likely milliseconds."""

_LEAST_STUCK = 8
"""Assumed: consecutive equal readings from which a channel may be stuck."""

_SETTINGS = frozenset({"distance_m", "branch", "frequency_Hz"})  # beside the currents
_FEW = 5
"""Assumed: other readings that show whether a channel has noise."""

_STUCK_CHANCE = 1e-3
"""Conventional: expected number of such stretches by chance, from how often repeats are equal."""

_LEAST_STUCK_SAMPLES, _MUCH_LONGER = 50, 20
"""Assumed: samples of one and the same reading, and how much longer than the channel's usual ones that must be."""

_LEAST_SHARE = 0.05
"""Assumed: part of the model's largest distance or current that a converted column must reach: zero always fits."""

_MOST_IMPOSSIBLE = 0.02
"""Assumed: largest part of a channel that can be impossible by single faults."""

_LEAST_CLIPPED, _PILED = 20, 5
"""Assumed: samples at the end of a range, and how many times those of the next hundredth of the range that must be."""

_EFFECTIVE_BITS, _DIFFERENCES = 20, 7
"""Conventional: noise of the best converters is 2^-20 of their range; differences in which smooth motion dies out."""


@dataclass(frozen=True)
class Expected:
    """What a model says beside the rows of a frame: readings by channel, NaN where none, and the limits of settings."""

    predicted: Mapping[str, FloatArray] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Change(Finding):
    """A finding of a check that goes on with another table: without some readings, or with their sign turned."""

    then: Callable[[pd.DataFrame], pd.DataFrame] = field(compare=False, repr=False)


Check = Callable[[pd.DataFrame, Expected | None], list[Finding]]


def checked(
    frame: pd.DataFrame, checks: Iterable[Check], model: Expected | None = None
) -> tuple[pd.DataFrame, list[Finding]]:
    """What checks say of a frame, each going on with what the one before leaves of it."""
    findings = []
    for check in checks:
        for remark in check(frame, model):
            frame = remark.then(frame) if isinstance(remark, Change) else frame
            findings.append(Finding(**{part.name: getattr(remark, part.name) for part in fields(Finding)}))
    return frame, findings


def changing(remark: Finding, then: Callable[[pd.DataFrame], pd.DataFrame]) -> Change:
    """A finding after which the table is what ``then`` makes of it."""
    return Change(**vars(remark), then=then)


def set_aside(remark: Finding, cells: BoolArray) -> Change:
    """A finding beside which cells of its column count as missing."""
    return changing(remark, lambda frame: frame.assign(**{remark.column: frame[remark.column].mask(cells)}))


def suspected_units(rows: pd.DataFrame, model: Expected | None, *, solved: bool = False) -> list[Finding]:
    """Columns that seem to be in another unit, or of the other sign, than their name says.

    A setting of which a model has limits is judged by these, any other column by the sizes that no actuator has. In a
    table that was computed (``solved``) one impossible number is enough: it is no outlier.
    """
    limits = model.limits if model else {}
    findings = [
        remark for name, box in limits.items() for remark in _by_limits(rows[name].dropna().to_numpy(), name, box)
    ]
    for name in (str(name) for name in rows if common_factors(str(name)) and name not in limits):
        size = np.abs(rows[name].to_numpy(dtype=np.float64))
        findings += _by_size(size[np.isfinite(size)], name, solved=solved)
    for name in (name for name in ("coil_temperature_C", "magnet_temperature_C") if name in rows):
        low, high = rows[name].min(), rows[name].max()
        if _KELVIN[0] < low and high < _KELVIN[1]:
            why = f"it lies between {low:.4g} and {high:.4g}"
            findings.append(finding("suspected-unit kelvin", column=name, why=why))
    step = float(rows["time_s"].diff().abs().median()) if "time_s" in rows else 0.0
    if step > _LARGEST_STEP_S:
        findings.append(suspicion("time_s", "ms", f"its usual step is {step:.4g}"))
    return findings


def _by_limits(values: FloatArray, name: str, limits: tuple[float, float]) -> list[Finding]:
    """The unit or sign by which settings that lie outside of a model's limits lie inside."""
    low, high = limits
    slack = 0.05 * (high - low)
    as_read = (values >= low - slack) & (values <= high + slack)
    for unit, factor in (common_factors(name) | {OTHER_SIGN: -1.0}).items():
        converted = factor * values
        as_converted = (converted >= low - slack) & (converted <= high + slack)
        few = as_read[~(as_read & as_converted)].sum() < 0.2 * len(values)  # no current is none in any unit
        reaches = float(np.abs(converted).max(initial=0.0)) >= _LEAST_SHARE * max(abs(low), abs(high))
        if reaches and few and (as_converted & ~as_read).sum() >= LEAST_READINGS and as_converted.mean() > 0.8:
            why = "few rows lie in the model's range, but then they would"
            return [other_sign(why, name) if unit == OTHER_SIGN else suspicion(name, unit, why)]
    return []


def _by_size(size: FloatArray, name: str, *, solved: bool) -> list[Finding]:
    """The unit in which magnitudes would be usual, of all of them or of a group of their own."""
    limit, (unit, factor) = CHANNELS[name], next(iter(common_factors(name).items()))
    beyond, median = size[size > limit.usual], float(np.median(size)) if len(size) else 0.0
    within = size[(size <= limit.usual) & (size > 0.0)]
    # Half of the factor or more away on a scale of ratios: one unit has smaller steps
    enough, largest = min(len(within), len(beyond)) >= LEAST_READINGS, size.max(initial=0.0)
    if enough and beyond.min() > within.max() / np.sqrt(factor) and largest <= limit.possible / factor:
        facts = {"rows": len(size), "unit": unit, "why": f"they are up to {largest:.3g}"}
        return [finding("suspected-unit rows", size=float(len(beyond)), column=name, **facts)]
    if limit.usual < median <= limit.usual / factor:
        return [suspicion(name, unit, f"it is {median:.3g} in the median")]
    if (solved or enough) and largest > limit.possible:
        code = "suspected-unit" if largest <= limit.possible / factor else "suspected-unit impossible"
        return [finding(code, column=name, unit=unit, why=f"it goes up to {largest:.3g}")]
    return []


def copies(rows: pd.DataFrame, _model: Expected | None) -> list[Finding]:
    """Rows that stand twice in every column that the file has: a file joined with itself makes the noise look smaller.

    Without numbers of run and order rows may be equal by chance, and are kept; but not where all of a table follows
    itself once more. Of a record whole segments are copies.
    """
    given = rows.drop(columns="segment", errors="ignore").reset_index(drop=True)
    repeated = given.duplicated().to_numpy()
    if "segment" in rows:
        repeated = pd.Series(repeated).groupby(rows["segment"].to_numpy()).transform("all").to_numpy()
    elif not {"run", "order"} <= set(given):
        as_first = (given == given.iloc[0]) | (given.isna() & given.iloc[0].isna())
        length = int(np.r_[np.flatnonzero(as_first.all(axis=1)), len(given)][1])
        before = given[: len(given) - length]
        pasted = _LEAST_STUCK <= length <= len(given) // 2 and given[length:].reset_index(drop=True).equals(before)
        numbers = before.to_numpy(dtype=np.float64).ravel()
        # Three digits may repeat by themselves
        pasted = pasted and any(float(f"{x:.3g}") != x for x in numbers[np.isfinite(numbers)])
        repeated = (np.arange(len(given)) >= length) & pasted
    count = int(repeated.sum())
    remark = finding("copies", size=float(count), rows=count)
    return [changing(remark, lambda frame: frame[~repeated])] if count else []


def faulty_readings(rows: pd.DataFrame, _model: Expected | None) -> list[Finding]:
    """Readings that are impossible, and stretches of equal ones over settings that change, where others show noise.

    Where a reading equals the one before with the chance p, n p^(L - 1) stretches of n readings are longer than L by
    chance. Without a current, where there is one elsewhere, what is computed may be constant; a reading of zero may be
    below the channel's step; a voltage may be commanded.
    """
    findings = _impossible_readings(rows)
    currents = [name for name in map(str, rows) if is_current(name)]
    settings = [*currents, *(name for name in rows if name in _SETTINGS)]
    quantities = {str(name): parts_of(str(name))[0] for name in rows}
    read = {name: CHANNELS.get(quantity, Channel()).bench == "reading" for name, quantity in quantities.items()}
    for name in (name for name, quantity in quantities.items() if read[name] and quantity != "voltage_V"):
        readable = rows[rows[name].notna()]
        values = readable[name].to_numpy()
        length, stretch = equal_stretches(values, readable["run"].to_numpy())
        driven = (readable[currents].fillna(0.0) != 0.0).any(axis=1).to_numpy()
        moves = (readable[settings].diff().fillna(0.0) != 0.0).any(axis=1).to_numpy() & (driven | ~driven.any())
        steps = np.diff(values)[length[stretch[1:]] < _LEAST_STUCK]
        equal = (np.sum(steps == 0.0) + 1.0) / (len(steps) + 2.0)
        least = max(_LEAST_STUCK, 1.0 + np.log(_STUCK_CHANCE / max(len(values), 1)) / np.log(equal))
        long = np.bincount(stretch, moves & (values != 0.0), len(length)) >= least
        stuck = long[stretch] & (len(steps) >= _FEW)
        for value in dict.fromkeys(values[stuck].tolist()):
            members = stuck & (values == value)
            counts = length[np.unique(stretch[members])]
            facts = {"value": value, "rows": " and ".join(map(str, counts))}
            remark = finding("stuck bench", size=float(counts.sum()), column=name, **facts)
            findings.append(set_aside(remark, rows.index.isin(readable.index[members])))
    return findings


def impossible(values: FloatArray, name: str) -> BoolArray:
    """Readings of a column that no bench has, such as 1e30 A; many are a wrong unit, where it is often in another."""
    quantity = parts_of(name)[0]
    low, high = possible_range(quantity)
    beyond = (values < low) | (values > high)
    return beyond & (beyond.mean() <= _MOST_IMPOSSIBLE or not common_factors(quantity))


def _impossible_readings(rows: pd.DataFrame) -> list[Finding]:
    """Beside which each column goes on without them."""
    findings: list[Finding] = []
    for name in map(str, rows):
        values = rows[name].to_numpy(dtype=np.float64)
        beyond = impossible(values, name)
        if beyond.any():
            low, high = possible_range(parts_of(name)[0])
            first, count = int(np.argmax(beyond)), int(beyond.sum())
            place = f" at {rows['time_s'].iloc[first]:.6g} s" if "time_s" in rows else ""
            facts = {"readings": count, "limits": f"{low:g} to {high:g}", "first": values[first], "place": place}
            findings.append(set_aside(finding("outliers impossible", size=float(count), column=name, **facts), beyond))
    return findings


def faulty_samples(rows: pd.DataFrame, _model: Expected | None) -> list[Finding]:
    """Impossible samples, and those of a record's sensors: missing, stuck or clipped.

    What was computed may stand still, and so may one channel where all that move were computed.
    """
    findings = _impossible_readings(rows)
    time = rows["time_s"].to_numpy()
    sensors = [name for name in map(str, rows) if CHANNELS.get(parts_of(name)[0], Channel()).sensor]
    moving = [values for name in sensors if len(np.unique(values := rows[name].dropna().to_numpy())) > 1]
    simulated = bool(moving) and all(map(_is_computed, moving))
    for name in map(str, rows):
        sensor, values = CHANNELS.get(parts_of(name)[0], Channel()).sensor, rows[name].to_numpy()
        missing, values = int(np.isnan(values).sum()), np.where(impossible(values, name), np.nan, values)
        readable = np.isfinite(values)
        if not (sensor and readable.any()):
            continue
        if missing:
            findings.append(finding("cells missing", size=missing, column=name, cells=missing))
        length, stretch = equal_stretches(values)
        if _is_computed(values[readable]) or (simulated and len(length) == 1):
            continue
        clipped = _clipped(values)
        usual = float(np.quantile(length, 0.95)) if len(length) > 1 else 0.0  # nothing moves it at all
        long = length > max(_LEAST_STUCK_SAMPLES, _MUCH_LONGER * usual)
        stuck = long[stretch] & readable & (values != 0.0)  # a current that is off rests at zero
        for faulty, fault in ((stuck & ~clipped, "stuck"), (clipped, "clipped")):
            if faulty.any():
                levels = [f"{level:.4g}" for level in np.unique(values[faulty])]
                shown = " and ".join(levels[:2] + ["others"] * (len(levels) > 2))
                facts = {"samples": int(faulty.sum()), "levels": shown, "time": time[np.argmax(faulty)]}
                remark = finding(fault, size=float(faulty.sum()), column=name, **facts)
                findings.append(set_aside(remark, faulty))
    return findings


BENCH_CHECKS: tuple[Check, ...] = (suspected_units, faulty_readings)
"""Of readings at rest, once their copies are left out and they stand in order."""

RECORD_CHECKS: tuple[Check, ...] = (faulty_samples, suspected_units)
"""Of samples over time, once their clock and their copies are known."""


def equal_stretches(values: FloatArray, run: FloatArray | None = None) -> tuple[IntArray, IntArray]:
    """Length of each stretch of one and the same reading, within a run, and the stretch of each sample."""
    changes = np.diff(values, prepend=values[:1]) != 0.0
    if run is not None:
        changes |= np.diff(run, prepend=run[:1]) != 0.0
    stretch = np.cumsum(changes)
    return np.bincount(stretch), stretch


def _is_computed(values: FloatArray) -> bool:
    """Whether samples that move scatter by less than any sensor's: differences of white noise grow as the binomials."""
    length, stretch = equal_stretches(values)
    moving = values[length[stretch] <= _DIFFERENCES]
    scatter = np.diff(moving, _DIFFERENCES)
    finest = 2.0**-_EFFECTIVE_BITS * comb(2 * _DIFFERENCES, _DIFFERENCES) ** 0.5
    return len(scatter) > _LEAST_CLIPPED and bool(robust_deviation(scatter) < finest * np.ptp(moving))


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
