"""Recorded loops as the time series file of the contract."""

from pathlib import Path

import numpy as np

from femfit.core.atomic import replacing
from femfit.simulation.loop import LoopResult

COLUMNS = (
    "run",
    "time_s",
    "voltage_V",
    "current_A",
    "distance_m",
    "hall_V",
    "reference_m",
    "estimated_distance_m",
    "estimated_velocity_m_s",
    "estimated_current_A",
)


def write_time_series(path: Path, result: LoopResult) -> None:
    """Write one row a sample and recorded run, up to the sample at which the run was lost.

    Parameters
    ----------
    path : Path
        Of the CSV file; its directory is made.
    """
    series = result.series
    rows = []
    for run in range(series.distance_m.shape[1]):
        known = np.flatnonzero(np.isfinite(series.distance_m[:, run]))
        columns = (
            np.full(len(known), run + 1.0),
            result.time_s[known],
            *(
                array[known, run]
                for array in (
                    series.voltage_V,
                    series.current_A,
                    series.distance_m,
                    series.hall_V,
                    series.reference_m,
                    series.estimated_distance_m,
                    series.estimated_velocity_m_s,
                    series.estimated_current_A,
                )
            ),
        )
        rows.append(np.stack(columns, axis=1))
    table = np.concatenate(rows) if rows else np.empty((0, len(COLUMNS)))
    with replacing(path) as partial:
        np.savetxt(partial, table, delimiter=",", header=",".join(COLUMNS), comments="", fmt=["%d"] + ["%.9g"] * 9)
