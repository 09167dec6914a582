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
    if any(type(measurement) is not type(first) for measurement in measurements):
        raise TableError("Measurements that are taken together must be bench tables alone, or records over time alone.")
    if any(dict(measurement.declared_noise) != dict(first.declared_noise) for measurement in measurements):
        raise TableError(
            f"Measurements that are taken together must have one declared noise; {first.source} and another differ. "
            "Declare the same for all, or take them one by one."
        )
    for k, measurement in enumerate(measurements):
        if any(measurement.rows.equals(earlier.rows) for earlier in measurements[:k]):
            raise TableError(
                f"{measurement.source} holds the same readings as another one that was given. Give each once."
            )
    rows = pd.concat(_numbered(measurements), ignore_index=True)
    common = [
        name
        for name in first.given
        if name != "order" or all("order" in measurement.given for measurement in measurements)
    ]
    columns = tuple(
        dict.fromkeys(
            [*common, *(name for measurement in measurements for name in measurement.given if name != "order")]
        )
    )
    findings = tuple(dict.fromkeys(finding for measurement in measurements for finding in measurement.findings))
    result = replace(
        first, rows=rows, given=columns, findings=findings, source=" and ".join(o.source for o in measurements)
    )
    return replace(result, clipped=_clipped(measurements)) if isinstance(result, TimeSeries) else result


def _numbered(measurements: Sequence[Measurement]) -> list[pd.DataFrame]:
    """The rows of each, with runs, mounts and segments numbered on."""
    result, begin = [], dict.fromkeys(("run", "mount", "segment"), 0)
    for measurement in measurements:
        rows = measurement.rows.copy()
        if isinstance(measurement, BenchTable):
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
    records = [record for record in series if isinstance(record, TimeSeries)]
    names = dict.fromkeys(name for record in records for name in record.clipped)
    return {
        name: np.concatenate([record.clipped.get(name, np.full(len(record.rows), np.nan)) for record in records])
        for name in names
    }
