"""A measured file of either kind, bench table or time series, and its place beside a model."""

from collections.abc import Mapping
from pathlib import Path

from femfit.identify.readings.observations import Observations, bench_observations
from femfit.identify.readings.plausible import plausible_table
from femfit.identify.series.observations import series_observations
from femfit.model.actuator_model import ActuatorModel
from femfit.tables import measurement_file
from femfit.tables.measurement import Measurement, TimeSeries


def read_measurement(
    path: str | Path,
    model: ActuatorModel,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> Measurement:
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
    data = measurement_file.read_measurement(path, columns=columns, units=units)
    return data if isinstance(data, TimeSeries) else plausible_table(model, data)


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
