"""A measured file of either kind, bench table or time series, and its place beside a model."""

from pathlib import Path

from femfit.identify.readings.observations import Observations, bench_observations
from femfit.identify.readings.plausible import plausible_table
from femfit.identify.series.observations import series_observations
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import BenchTable
from femfit.tables.measurement_file import read_bench_table
from femfit.tables.time_series import TimeSeries
from femfit.tables.time_series_file import is_time_series, read_time_series

Measurement = BenchTable | TimeSeries


def read_measurement(path: Path, model: ActuatorModel) -> Measurement:
    """Read a measured file of either kind.

    Parameters
    ----------
    path : Path
        A file with a column of times is a time series, any other a bench table.
    model : ActuatorModel
        With which the readings are to be compared: what contradicts its sensors is set aside, and said.

    Raises
    ------
    TableError
        If there is no such file, or it is no table of either kind.
    """
    if is_time_series(path):
        return read_time_series(path)
    return plausible_table(model, read_bench_table(path))


def measurement_observations(model: ActuatorModel, data: Measurement) -> Observations:
    """Place a measurement of either kind beside a model.

    Returns
    -------
    Observations
        Readings of a bench, or windows of a time series.

    Raises
    ------
    TableError
        If nothing of it can be compared.
    """
    if isinstance(data, TimeSeries):
        return series_observations(model, data)
    return bench_observations(model, data)
