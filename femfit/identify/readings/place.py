"""Places a measured file or table of either kind, bench table or record over time, beside a model."""

from pathlib import Path

from femfit.core.errors import TableError
from femfit.core.results import Finding
from femfit.identify.constants import MOST_ROWS
from femfit.identify.readings.bench import bench_observations
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.plausible import plausible_table
from femfit.identify.readings.settings import inductive, without_bias
from femfit.identify.series.observations import series_observations
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import BenchTable, Measurement, TimeSeries
from femfit.tables.measurement_file import read_measurement


def measurement_of(data: Measurement | str | Path) -> Measurement:
    """The measurement, read where a path is given."""
    return data if isinstance(data, BenchTable | TimeSeries) else read_measurement(data)


def placed(model: ActuatorModel, data: Measurement | str | Path) -> Observations:
    """Place a measurement beside a model, what contradicts the model's sensors set aside.

    Raises
    ------
    TableError
        If a bench table has so many rows that a comparison takes hours, or no reading that the model predicts.
    """
    data = measurement_of(data)
    if isinstance(data, TimeSeries):
        return series_observations(model, data)
    if len(data.rows) > MOST_ROWS:
        raise TableError(
            f"{data.source} must have at most {MOST_ROWS:,} rows to be compared with a model; instead received "
            f"{len(data.rows):,}, for which time and memory do not suffice. Give the mean of each setting in each run, "
            "and its noise with --noise, or some of the runs."
        )
    return bench_observations(model, plausible_table(model, inductive(model, without_bias(model, data))))


def suspicions(findings: tuple[Finding, ...]) -> list[str]:
    """What a reader must know before any number, as lines: units and signs that are suspected."""
    return [f"Check first: {one}" for one in findings if one.code.startswith("suspected")]


def notes(findings: tuple[Finding, ...]) -> list[str]:
    """The other findings as lines, warnings first."""
    others = [one for one in findings if not one.code.startswith("suspected")]
    return [
        *(f"Warning: {one}" for one in others if one.severity != "info"),
        *(f"note: {one}" for one in others if one.severity == "info"),
    ]
