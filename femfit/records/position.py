"""The distance of a record that a position sensor gives in volts."""

from dataclasses import replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.finding import Finding
from femfit.device.sensors import PositionSensor
from femfit.model.actuator_model import ActuatorModel
from femfit.model.sensors import piece_slope, reading_of
from femfit.tables.measurement import TimeSeries


def with_distance(model: ActuatorModel, series: TimeSeries) -> TimeSeries:
    """The record with ``distance_m`` where it has none and a position sensor of the model tells it; its noise too."""
    if "distance_m" in series.given:
        return series
    for sensor in model.other_sensors:
        column = reading_of(model, sensor.name).column
        if not isinstance(sensor, PositionSensor) or column not in series.given:
            continue
        distance = distance_of(sensor, series.rows[column].to_numpy())
        slope = np.abs(piece_slope(sensor, distance[np.isfinite(distance)]))
        declared, noise = series.declared_noise.get(str(column)), dict(series.declared_noise)
        if declared and len(slope):
            noise["distance_m"] = declared / float(np.median(slope))
        text = f"distance_m is worked out from {column} by the characteristic of sensor {sensor.name}."
        return replace(
            series,
            rows=series.rows.assign(distance_m=distance),
            given=(*series.given, "distance_m"),
            declared_noise=noise,
            findings=(*series.findings, Finding("distance", "info", text, column="distance_m")),
        )
    return series


def distance_of(sensor: PositionSensor, readings: FloatArray) -> FloatArray:
    """Distances in m that give these readings; beyond the characteristic its last pieces go on."""
    at, read = np.asarray(sensor.distances_m), np.asarray(sensor.readings)
    order = np.argsort(read)
    found = np.interp(readings, read[order], at[order])
    for end in (0, -1):  # np.interp stays at the ends
        beyond = (readings - read[end]) * np.sign(read[-1] - read[0]) * (1 if end else -1) > 0.0
        slope = float(piece_slope(sensor, at[end : end + 1 or None])[0])
        found = np.where(beyond, at[end] + (readings - read[end]) / slope, found)
    return np.asarray(found)
