"""Measurements: a bench table with one row a reading, and a time series with one row a sample.

Several measurements of one device as one, each file's runs further runs.

The order of their rows: as they were measured, with the current's branch, and a record's clock in segments.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray, IntArray
from femfit.core.results import Finding, Printed, listing
from femfit.core.text import amount, counted
from femfit.tables.findings import finding, refused
from femfit.tables.header import parts_of
from femfit.tables.units import CHANNELS as REGISTRY

CHANNELS = tuple(name for name, channel in REGISTRY.items() if channel.bench == "reading")
"""Columns that a bench reads."""


OF_RUNS = "run."
"""Begins the key of a declared standard deviation of what all readings of a run share: run.force_N."""

IMPEDANCE_SHARE = "impedance_share"
"""Key of the declared standard deviation of an impedance's readings as a share of its magnitude."""


def channel_words(channel: str) -> str:
    """What sentences call a channel, one of several circuits, or a balance that a time series is turned into."""
    quantity, circuit = parts_of(channel)
    noun = REGISTRY[quantity].noun or quantity
    return f"{noun} of {circuit}" if circuit else noun


SETTINGS: dict[str, float] = {name: channel.absent for name, channel in REGISTRY.items() if channel.bench == "setting"}
"""Columns that say where and when a reading was taken, with the value that stands for a missing column.

``frequency_Hz`` is that of the small current of an impedance; without it inductance and resistance are those at low
frequency.
"""

SERIES_CHANNELS = tuple(
    sorted((name for name in REGISTRY if REGISTRY[name].record), key=lambda name: REGISTRY[name].record)
)
"""Columns that a time series may record."""

SERIES_COLUMNS = ("run", "time_s", *SERIES_CHANNELS)
"""All columns of a time series."""


@dataclass(frozen=True, eq=False, repr=False)
class _Measured(Printed):
    """What bench tables and time series have in common."""

    rows: pd.DataFrame
    given: tuple[str, ...]  # The columns that the file has with at least one number
    # Standard deviation of a channel's reading, in the channel's unit
    declared_noise: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    source: str = "measurement"
    test_object: str = ""
    notes: str = ""

    kind: ClassVar[str]
    known_channels: ClassVar[tuple[str, ...]]

    @property
    def channels(self) -> tuple[str, ...]:
        """The measured channels that the file has, those of several circuits after the others."""
        of_circuits = (name for name in self.given if parts_of(name)[1] and parts_of(name)[0] in self.known_channels)
        return (*(name for name in self.known_channels if name in self.given), *of_circuits)

    def __str__(self) -> str:
        """Say what the file holds, one line a fact, what must be looked at first."""
        rows, runs = self.rows, self.rows["run"].nunique()
        lines = [f"{self.source}: {len(rows)} {self.kind} in {runs} run{'s' * (runs != 1)} of {listing(self.channels)}"]
        settings = ("distance_m", "current_A", *(name for name in self.given if parts_of(name)[0] == "current_A"))
        placed = [name for name in dict.fromkeys(settings) if rows[name].notna().any()]
        lines += [f"  {name} {rows[name].min():.4g} to {rows[name].max():.4g}" for name in placed]
        lines += [f"  declared noise of {name}: {value:.3g}" for name, value in self.declared_noise.items()]
        first = [f"check first: {finding}" for finding in self.findings if finding.severity != "info"]
        return "\n".join(
            [*first, *lines, *(f"note: {finding}" for finding in self.findings if finding.severity == "info")]
        )

    def _repr_html_(self) -> str:
        return super()._repr_html_() + str(self.rows.to_html(max_rows=12))


@dataclass(frozen=True, eq=False, repr=False)
class BenchTable(_Measured):
    """A bench measurement, read and checked.

    ``rows`` has every column of :data:`SETTINGS` and :data:`CHANNELS` as float64; a reading that is missing, or that a
    check has set aside, is NaN. Rows of one run stand together in the order of measuring.

    Examples
    --------
    >>> import femfit as ff
    >>> bench = ff.read_measurement("bench.csv")
    >>> len(bench.rows), sorted(set(bench.rows["run"]))
    (448, [1.0, 2.0, 3.0, 4.0])
    """

    noise_source: str = "declared"  # Or ``samples``: the noise of means of many rows, from these rows

    kind: ClassVar[str] = "readings"
    known_channels: ClassVar[tuple[str, ...]] = CHANNELS


@dataclass(frozen=True, eq=False, repr=False)
class TimeSeries(_Measured):
    """A recorded time series, read and checked.

    ``rows`` has every column of :data:`SERIES_COLUMNS` as float64, and ``segment``: rows of one segment follow each
    other on a clock that runs on without a gap. A reading that is missing, or that a check has set aside, is NaN.

    Examples
    --------
    >>> import femfit as ff
    >>> record = ff.read_measurement("loop.csv")
    >>> record.channels
    ('current_A', 'distance_m', 'hall_V')
    """

    kind: ClassVar[str] = "samples"
    known_channels: ClassVar[tuple[str, ...]] = SERIES_CHANNELS


@dataclass(frozen=True, eq=False)
class InductanceTable:
    """Measured inductances, each array of shape (n,), in SI.

    An inductance is flux linkage over current, as a step from zero to that current shows it.
    """

    distance: FloatArray
    current: FloatArray
    inductance: FloatArray
    findings: tuple[Finding, ...] = ()
    source: str = "inductances"


Measurement = BenchTable | TimeSeries


def joined_measurements(measurements: Sequence[Measurement]) -> Measurement:
    """One measurement of all; runs, mounts and segments of each file are its own.

    Raises
    ------
    TableError
        If there is none, bench tables stand beside records, their declared noises differ, or two are the same.
    """
    if not measurements:
        raise TableError("No measurement is given. Give a bench table, or a record over time.")
    first = measurements[0]
    if len(measurements) == 1:
        return first
    if any(type(measurement) is not type(first) for measurement in measurements):
        raise TableError("Measurements that are taken together must be bench tables alone, or records over time alone.")
    if any(dict(measurement.declared_noise) != dict(first.declared_noise) for measurement in measurements):
        raise refused("noises-differ", source=first.source)
    for k, measurement in enumerate(measurements):
        if any(measurement.rows.equals(earlier.rows) for earlier in measurements[:k]):
            raise refused("same-readings", source=measurement.source)
    pieces, begin = [], dict.fromkeys(("run", "mount", "segment"), 0)
    for measurement in measurements:
        rows = measurement.rows.copy()
        if isinstance(measurement, BenchTable):
            rows["mount"] = rows["mount"].where(rows["mount"].notna(), rows["run"])
        for name in begin.keys() & set(rows):  # numbered on
            number = begin[name] + 1 + pd.factorize(rows[name])[0]
            rows[name] = pd.Series(number, index=rows.index).astype(rows[name].dtype)
            begin[name] = int(number.max())
        pieces.append(rows)
    ordered = all("order" in measurement.given for measurement in measurements)
    columns = dict.fromkeys(name for measurement in measurements for name in measurement.given)
    return replace(
        first,
        rows=pd.concat(pieces, ignore_index=True),
        given=tuple(name for name in columns if ordered or name != "order"),
        findings=tuple(dict.fromkeys(finding for measurement in measurements for finding in measurement.findings)),
        source=" and ".join(measurement.source for measurement in measurements),
    )


STILL_CURRENT = 0.005
"""Assumed: change of the current, over all of its range, that is the ammeter's and no step."""

_TURNS = 0.25
"""Assumed: turns over steps up to which currents were cycled; currents in random order turn at two steps of three."""

_BOTH = 0.1
"""Assumed: part of the rows whose steps must rise, and fall, and follow a step at the same distance."""

_SINGLE = 0.02
"""Assumed: steps back in a file, over its rows, up to which a clock was reset; more are a file sorted by something
else."""


_SHARE = 0.1
"""Conventional: part of the steps that stand still from which the stamps are coarse; fewer are single faults."""

_PAUSE = 5.0
"""Assumed: a step of the clock longer than this many times the usual longest (95 %) one is a gap."""


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
    for run, piece in rows.groupby("run", sort=False):
        order = piece["order"].to_numpy()
        back, twice = int(np.sum(np.diff(order) < 0.0)), len(order) - len(np.unique(order))
        numbered = bool(np.all(order == np.round(order)))
        gaps = np.isnan(order)
        if not gaps.any() and not twice and (numbered or not 0 < back <= max(1.0, _SINGLE * len(order))):
            pieces.append(piece.sort_values("order", kind="stable"))
            continue
        pieces.append(piece.assign(order=np.arange(len(piece), dtype=np.float64)))
        fault = f"goes back {counted(back, 'time')}" if back else f"holds {counted(twice, 'number')} twice"
        if not gaps.any():
            findings.append(finding("order reset", column="order", run=run, fault=fault))
        elif not gaps.all():
            findings.append(finding("order gaps", column="order", run=run))
    return pd.concat(pieces, ignore_index=True), findings


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


def check_clock(rows: pd.DataFrame, source: str = "the record") -> tuple[IntArray, list[Finding]]:
    """Find where a clock jumps back, stands still or pauses, and number the segments between."""
    time, run = rows["time_s"].to_numpy(), rows["run"].to_numpy()
    step, same = np.diff(time), np.diff(run) == 0.0
    forward = step[same & (step > 0.0)]
    if not len(forward):
        raise refused("clock-stands", source=source, samples=len(rows), begin=time.min(), end=time.max())
    if (step[same] == 0.0).mean() > _SHARE:
        raise refused("coarse-stamps", source=source, step=amount(float(np.median(forward)), "s"))
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
