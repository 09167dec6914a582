"""Several measurements of one device as one, each file's runs further runs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.tables.measurement import BenchTable, Measurement, TimeSeries


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
    if any(type(one) is not type(first) for one in measurements):
        raise TableError("Measurements that are taken together must be bench tables alone, or records over time alone.")
    if any(dict(one.declared_noise) != dict(first.declared_noise) for one in measurements):
        raise TableError(
            f"Measurements that are taken together must have one declared noise; {first.source} and another differ. "
            "Declare the same for all, or take them one by one."
        )
    for k, one in enumerate(measurements):
        if any(one.rows.equals(other.rows) for other in measurements[:k]):
            raise TableError(f"{one.source} holds the same readings as another one that was given. Give each once.")
    rows = pd.concat(_numbered(measurements), ignore_index=True)
    common = [name for name in first.given if name != "order" or all("order" in one.given for one in measurements)]
    given = tuple(dict.fromkeys([*common, *(name for one in measurements for name in one.given if name != "order")]))
    findings = tuple(dict.fromkeys(finding for one in measurements for finding in one.findings))
    result = replace(
        first, rows=rows, given=given, findings=findings, source=" and ".join(o.source for o in measurements)
    )
    return replace(result, clipped=_clipped(measurements)) if isinstance(result, TimeSeries) else result


def _numbered(measurements: Sequence[Measurement]) -> list[pd.DataFrame]:
    """The rows of each, with runs, mounts and segments numbered on."""
    result, begin = [], dict.fromkeys(("run", "mount", "segment"), 0)
    for one in measurements:
        rows = one.rows.copy()
        if isinstance(one, BenchTable):
            rows["mount"] = rows["mount"].where(rows["mount"].notna(), rows["run"])
        for name, start in begin.items():
            if name in rows:
                number = pd.factorize(rows[name])[0]
                rows[name] = pd.Series(start + 1 + number, index=rows.index).astype(rows[name].dtype)
                begin[name] = start + int(number.max()) + 1
        result.append(rows)
    return result


def _clipped(series: Sequence[Measurement]) -> dict[str, np.ndarray]:
    """The ends at which samples are clipped, of channels of all files."""
    records = [one for one in series if isinstance(one, TimeSeries)]
    names = dict.fromkeys(name for one in records for name in one.clipped)
    return {
        name: np.concatenate([one.clipped.get(name, np.full(len(one.rows), np.nan)) for one in records])
        for name in names
    }
