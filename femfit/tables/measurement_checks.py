"""Checks of a bench table on its own, without a model: what is set aside, and what is suspected and said."""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.arrays import BoolArray, FloatArray
from femfit.tables.measurement import CHANNELS, SETTINGS, BenchTable
from femfit.tables.outliers import isolated_outliers

_LARGEST_DISTANCE_M = 0.5
"""A usual gap is far below; a median above it is a distance in mm or cm."""

_LEAST_COPIES = 5
"""Rows on end that equal earlier ones and are copies, where no order tells: single readings may be equal by chance."""

_KELVIN = (200.0, 400.0)
_LEAST_STUCK = 8
"""Consecutive equal readings from which a channel may be stuck."""

_STUCK_CHANCE = 1e-3
"""Expected number of such stretches by chance, from how often successive readings are equal."""


def checked(table: BenchTable) -> BenchTable:
    """A table with what cannot be right set aside, each time with a sentence.

    Returns
    -------
    BenchTable
        Readings of stuck channels and lone outliers NaN, and distances that are none.
    """
    rows = table.rows
    findings = _suspected_units(rows)
    rows, said = _sensible_distances(rows)
    findings += said
    for name in table.channels:
        values, said = _without_stuck(rows, name)
        findings += said
        rows = rows.assign(**{name: values})
        values, said = without_outliers(rows, name, values)
        findings += said
        rows = rows.assign(**{name: values})
    return replace(table, rows=rows, findings=(*table.findings, *findings))


def without_outliers(rows: pd.DataFrame, name: str, compared: FloatArray) -> tuple[FloatArray, list[str]]:
    """A channel without the single readings that contradict all their neighbours.

    Parameters
    ----------
    compared : array, shape (n,)
        What neighbours are compared by: the reading, or the reading minus a prediction. NaN is left out.

    Returns
    -------
    array, shape (n,)
        The channel's readings, NaN where set aside.
    """
    values = rows[name].to_numpy()
    here = np.flatnonzero(np.isfinite(values) & np.isfinite(compared) & _placed(rows))
    if len(here) < 2:
        return values, []
    run = pd.factorize(rows["run"].to_numpy()[here])[0]
    lone = here[isolated_outliers(compared[here], _places(rows)[here], run, _step(values[here]))]
    if not len(lone):
        return values, []
    kept = values.copy()
    kept[lone] = np.nan
    shown = "; ".join(_row(rows, int(k), name) for k in lone[:3])
    one = len(lone) == 1
    count = "1 reading contradicts" if one else f"{len(lone)} readings contradict"
    more = " and so on" if len(lone) > 3 else ""
    return kept, [f"{count} all neighbours in {name} and {'was' if one else 'were'} set aside: {shown}{more}."]


def without_copies(rows: pd.DataFrame, given: tuple[str, ...]) -> tuple[pd.DataFrame, list[str]]:
    """Rows once, where the same row stands twice: a file joined with itself would make the noise look smaller.

    Returns
    -------
    DataFrame
        Single rows that could be equal by chance are kept.
    """
    columns = [name for name in (*SETTINGS, *CHANNELS) if name in given]
    copies = rows.duplicated(subset=columns).to_numpy()
    if not {"run", "order"} <= set(given):
        block = np.cumsum(np.concatenate([[False], copies[1:] != copies[:-1]]))
        copies = copies & (np.bincount(block)[block] >= _LEAST_COPIES)
    if not copies.any():
        return rows, []
    count = int(copies.sum())
    text = f"{count} row{'s' * (count > 1)} repeat{'s' * (count == 1)} an earlier one in every column and "
    return rows[~copies].reset_index(drop=True), [f"{text}{'was' if count == 1 else 'were'} left out."]


def _suspected_units(rows: pd.DataFrame) -> list[str]:
    findings = []
    distance = float(rows["distance_m"].abs().median())
    if distance > _LARGEST_DISTANCE_M:
        findings.append(
            f"distance_m is {distance:.3g} in the median: that looks like millimetres. Name the column distance_mm."
        )
    for name in ("coil_temperature_C", "magnet_temperature_C"):
        values = rows[name].dropna()
        if len(values) and _KELVIN[0] < values.min() and values.max() < _KELVIN[1]:
            findings.append(
                f"{name} lies between {values.min():.4g} and {values.max():.4g}: that looks like kelvin. Subtract "
                "273.15."
            )
    return findings


def _sensible_distances(rows: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    wrong = (rows["distance_m"] <= 0.0).to_numpy()
    if not wrong.any():
        return rows, []
    low = float(rows["distance_m"].min())
    many = int(wrong.sum()) > 1
    text = (
        f"{int(wrong.sum())} row{'s have' if many else ' has'} a distance <= 0 (down to {low:g} m) and "
        f"{'were' if many else 'was'} left out; distances count from the electromagnet's face and are positive."
    )
    return rows[~wrong].reset_index(drop=True), [text]


def _without_stuck(rows: pd.DataFrame, name: str) -> tuple[FloatArray, list[str]]:
    """A channel without stretches of one and the same reading over changing settings."""
    values = rows[name].to_numpy().copy()
    here = np.flatnonzero(np.isfinite(values) & _placed(rows))
    if len(here) < _LEAST_STUCK:
        return values, []
    read, run = values[here], rows["run"].to_numpy()[here]
    places = _places(rows)[here]
    follows = np.concatenate([[False], (np.diff(read) == 0.0) & (np.diff(run) == 0.0)])
    stretch = np.cumsum(~follows) - 1
    length = np.bincount(stretch)
    found: dict[float, list[int]] = {}
    for one in np.flatnonzero(length >= _least_length(length)):
        rows_of = np.flatnonzero(stretch == one)
        if not _held(read, places, rows_of):
            continue
        values[here[rows_of]] = np.nan
        found.setdefault(float(read[rows_of[0]]), []).append(len(rows_of))
    return values, [
        f"{name} reads {value:.6g} in {' and '.join(map(str, counts))} rows on end while the settings change: stuck or "
        "clipped; these readings were set aside."
        for value, counts in found.items()
    ]


def _least_length(length: Any) -> float:
    """Length of a stretch of equal readings that chance does not make: n p^L = 1e-3."""
    short = length[length < _LEAST_STUCK]
    total = int(length.sum())
    equal = (float(np.sum(short - 1)) + 1.0) / (float(np.sum(short)) + 2.0)
    return max(float(_LEAST_STUCK), float(np.log(_STUCK_CHANCE / total) / np.log(equal)))


def _held(read: FloatArray, places: FloatArray, rows_of: Any) -> bool:
    """Whether the settings changed over the stretch, and other readings between the same settings do change."""
    low, high = places[rows_of].min(axis=0), places[rows_of].max(axis=0)
    if (high - low)[:2].max() < 0.1:
        return False
    other = np.ones(len(read), dtype=bool)
    other[rows_of] = False
    around = read[other & np.all((places[:, :2] >= low[:2]) & (places[:, :2] <= high[:2]), axis=1)]
    if len(around) < 3:
        around = read[other]
    return len(around) == 0 or float(np.ptp(around)) > 4.0 * _step(read)


def _placed(rows: pd.DataFrame) -> BoolArray:
    return np.asarray(np.isfinite(rows["distance_m"].to_numpy()) & np.isfinite(rows["current_A"].to_numpy()))


def _places(rows: pd.DataFrame) -> FloatArray:
    """Settings scaled to 0..1, the branches a little apart."""
    distance = rows["distance_m"].to_numpy()
    scaled = []
    for x in (np.log(np.where(distance > 0.0, distance, np.nan)), rows["current_A"].to_numpy()):
        low, high = (np.nanmin(x), np.nanmax(x)) if np.isfinite(x).any() else (0.0, 0.0)
        scaled.append((x - low) / max(high - low, 1e-300))
    return np.column_stack([*scaled, 0.1 * rows["branch"].to_numpy()])


def _step(values: FloatArray) -> float:
    """A channel's quantisation: the smallest usual distance between the levels of a coarse channel, else 0."""
    levels = np.unique(values)
    return float(np.quantile(np.diff(levels), 0.1)) if 1 < len(levels) < 0.9 * len(values) else 0.0


def _row(rows: pd.DataFrame, k: int, name: str) -> str:
    one = rows.iloc[k]
    where = f"{1e3 * one['distance_m']:.4g} mm and {one['current_A']:.4g} A"
    return f"{one[name]:.5g} at {where} (run {one['run']:g}, order {one['order']:g})"
